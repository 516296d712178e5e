"""From a record to the signature's parameters: the paper's CMA-ES."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from replication.arrays import FloatArray
from replication.compiled.bounds import from_box, into_box, margin_today
from replication.compiled.folded import fold
from replication.compiled.misfit import folded_rmse
from replication.compiled.whole_run import whole_run
from replication.datasets import Recording
from replication.search import Generation, Search, checked, generations, random_normals
from replication.signature import DAMPING_PER_S, FREQUENCY_HZ, Box, Timing, table1_box


@dataclass(frozen=True)
class Protocol:
    """How one CMA-ES fit is run; the defaults are the authors' notebook.

    The search starts from the middle of the box, with a quarter of its width as standard deviations.

    Attributes
    ----------
    name : str
        What tables call it.
    population, iterations : int
        Members of a generation, and the most generations.
    amplitude_factor : float
        How much wider than Table 1's the box of A is.
    longest_window_s : float
        Table 1's upper bound of T2, twice that of T1 [s].
    damping_per_s, frequency_hz : two floats
        Table 1's bounds of tau [1/s] and of omega over 2 pi [Hz].
    T_d, T_f : float
        The fixed delay of the second oscillation and turn period [s].
    turns : int
        Turns n in the model.
    start : str
        "whole" fits the whole record; "per run" and "per record" drop up to `latest_start` samples from its
        beginning, drawn anew for each run, or once for each record.
    latest_start : int
        Latest start sample.
    engine : str
        "2021" searches as the authors' library did, by `search`; "cma" by the library as it is installed.
    """

    name: str = "authors' notebook"
    population: int = 300
    iterations: int = 200
    amplitude_factor: float = 1.3
    longest_window_s: float = 0.204
    damping_per_s: tuple[float, float] = DAMPING_PER_S
    frequency_hz: tuple[float, float] = FREQUENCY_HZ
    T_d: float = 0.2
    T_f: float = 0.4
    turns: int = 12
    start: str = "whole"
    latest_start: int = 100
    engine: str = "2021"

    @property
    def timing(self) -> Timing:
        """The fixed part of the signature."""
        return Timing(self.T_d, self.T_f, self.turns)


@dataclass(frozen=True)
class Fit:
    """One fitted signature.

    Attributes
    ----------
    X : array of shape (7,)
        Parameters in `signature.FREE_PARAMETERS` order.
    rmse : float
        Misfit [rps].
    evaluations, iterations : int
        What the search spent.
    """

    X: FloatArray
    rmse: float
    evaluations: int
    iterations: int

    @property
    def amplitude_rps(self) -> float:
        """|A| [rps]: (A, t0) and (-A, t0 plus or minus T_d) are the same signal, so the sign says nothing."""
        return float(abs(self.X[0]))


def protocol_box(recording: Recording, protocol: Protocol) -> Box:
    """Table 1's box for a record, as the protocol widens it."""
    p = protocol
    return table1_box(recording.t, recording.v, p.longest_window_s, p.amplitude_factor, p.damping_per_s, p.frequency_hz)


def paper_search(recording: Recording, protocol: Protocol, seed: int) -> Iterator[Generation]:
    """The paper's search on a record, one generation at a time, without end; see `search.generations`."""
    misfits = _misfits(recording, protocol)
    return generations(misfits, protocol_box(recording, protocol), random_normals(seed), protocol.population)


def paper_run(recording: Recording, protocol: Protocol, seed: int) -> Search:
    """The same search as a whole, compiled; see `compiled.whole_run`."""
    record = fold(recording.t, recording.v, protocol.timing)
    return whole_run(record, protocol_box(recording, protocol), seed, protocol.population, protocol.iterations)


def paper_fit(recording: Recording, protocol: Protocol, seed: int) -> Fit:
    """Fit the signature to a record by CMA-ES, as the paper does.

    Parameters
    ----------
    recording : Recording
        The record, already cut to its start sample.
    protocol : Protocol
        Settings of the search.
    seed : int
        Seed of the run, above 0.

    Returns
    -------
    Fit

    Raises
    ------
    ValueError
        The protocol has another engine than "2021" and "cma", or see `search.checked` and `folded.fold`.
    """
    if protocol.engine == "cma":
        return _library_fit(recording, protocol, seed)
    if protocol.engine != "2021":
        raise ValueError(f"engine {protocol.engine!r}: expected '2021' or 'cma'")
    found = paper_run(recording, protocol, seed)
    return Fit(found.best, found.misfit, found.evaluations, len(found.history))


def first_generation_rmse(recording: Recording, protocol: Protocol, seed: int) -> float:
    """Lowest misfit [rps] of a run's first generation, which depends on nothing but seed, box and bound margins."""
    if protocol.engine == "cma":
        members = _library_members(library_search(recording, protocol, seed).ask(), recording, protocol)
        return float(_misfits(recording, protocol)(members).min())
    return float(next(paper_search(recording, protocol, seed)).misfits.min())


def library_search(recording: Recording, protocol: Protocol, seed: int) -> "cma.CMAEvolutionStrategy":  # noqa: F821
    """Today's `cma` on a record, without its slow bound handling: its samples still have to be put `into_box`.

    Tell it its own samples with `check_points=False`: it keeps no archive to know them by. The random numbers are
    those of cma's `seed` option, from a generator of their own.
    """
    import cma  # brings matplotlib, a second that no other engine needs
    from cma.evolution_strategy import get_CMASolutionDict

    box = protocol_box(recording, protocol)
    checked(box, protocol.population, protocol.iterations, seed)
    width = box.upper - box.lower
    options = {
        "popsize": protocol.population,
        "maxiter": protocol.iterations,
        "CMA_stds": width / 4,
        "maxstd": width * (1 / 3),  # what cma sets for a bounded problem
        "seed": np.nan,  # leave NumPy's global generator alone
        "randn": random_normals(seed),
        "verbose": -9,
        "verb_disp": 0,
        "verb_log": 0,
    }
    middle = from_box((box.lower + box.upper) / 2, box, margin_today)
    strategy = cma.CMAEvolutionStrategy(middle, 1.0, options)
    # The archive of samples serves cma's own bounds and injected solutions; keeping it costs a third of a run.
    strategy.sent_solutions = get_CMASolutionDict(False)()
    return strategy


def _library_fit(recording: Recording, protocol: Protocol, seed: int) -> Fit:
    misfits, strategy = _misfits(recording, protocol), library_search(recording, protocol, seed)
    while not strategy.stop():
        samples = strategy.ask()
        strategy.tell(samples, misfits(_library_members(samples, recording, protocol)), check_points=False)
    best = _library_members([strategy.best.x], recording, protocol)[0]
    return Fit(best, float(strategy.best.f), strategy.countevals, strategy.countiter)


def _library_members(samples: list[FloatArray], recording: Recording, protocol: Protocol) -> FloatArray:
    return into_box(np.array(samples), protocol_box(recording, protocol), margin_today)


def _misfits(recording: Recording, protocol: Protocol) -> Callable[[FloatArray], FloatArray]:
    """The cost function of a whole population."""
    record = fold(recording.t, recording.v, protocol.timing)
    return lambda members: folded_rmse(members, record)
