"""From a record to the signature's parameters: the paper's CMA-ES."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from replication.arrays import FloatArray
from replication.compiled.bounds import from_box, into_box, margin_today
from replication.compiled.misfit import fold, folded_rmse
from replication.compiled.whole_run import whole_run
from replication.recording import RPM_PER_RPS, Recording
from replication.search import Generation, Search, check_settings, generations, random_normals
from replication.signature import DAMPING_PER_S, FREQUENCY_HZ, Box, Timing, table1_box

if TYPE_CHECKING:
    import cma


@dataclass(frozen=True)
class Protocol:
    """How one CMA-ES fit is run; the defaults are the authors' notebook.

    The search starts from the middle of the box, with a quarter of its width as standard
    deviations. "per record" drops up to `latest_start` samples, drawn once, from a record's beginning.
    """

    name: str = "authors' notebook"  # what tables call it
    population: int = 300  # members of a generation
    iterations: int = 200  # the most generations
    amplitude_factor: float = 1.3  # how much wider than Table 1's the box of A is
    longest_window_s: float = 0.204  # Table 1's upper bound of T2, twice that of T1
    damping_per_s: tuple[float, float] = DAMPING_PER_S  # bounds of tau
    frequency_hz: tuple[float, float] = FREQUENCY_HZ  # bounds of omega over 2 pi
    T_d: float = 0.2  # delay of the second oscillation [s]
    T_f: float = 0.4  # turn period [s]
    turns: int = 12  # n of the model
    start: str = "whole"  # or "per record"
    latest_start: int = 100  # sample
    engine: str = "2021"  # as the authors' library searched, by `search`; "cma": as the installed library does
    rpm: bool = False  # the search sees 60 (v - mean v), as equation 10 has A, and not v in rps

    @property
    def timing(self) -> Timing:
        """The fixed part of the signature."""
        return Timing(self.T_d, self.T_f, self.turns)


@dataclass(frozen=True)
class Fit:
    """One fitted signature: its parameters in `FREE_PARAMETERS` order, its misfit [rps], what the search spent."""

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
    return table1_box(
        recording.t,
        recording.v,
        protocol.longest_window_s,
        protocol.amplitude_factor,
        protocol.damping_per_s,
        protocol.frequency_hz,
    )


def paper_search(recording: Recording, protocol: Protocol, seed: int) -> Iterator[Generation]:
    """The paper's search on a record, one generation at a time, without end.

    See `search.generations`.
    """
    record = fold(recording.t, recording.v, protocol.timing)
    box = protocol_box(recording, protocol)
    return generations(
        lambda members: folded_rmse(members, record), box, random_normals(seed), protocol.population
    )


def paper_run(recording: Recording, protocol: Protocol, seed: int) -> Search:
    """The same search as a whole, compiled; see `compiled.whole_run`."""
    record = fold(recording.t, recording.v, protocol.timing)
    return whole_run(
        record, protocol_box(recording, protocol), seed, protocol.population, protocol.iterations
    )


def paper_fit(recording: Recording, protocol: Protocol, seed: int) -> Fit:
    """Fit the signature to a record by CMA-ES, as the paper does (equations 7 and 11 to 17).

    Parameters
    ----------
    recording : Recording
        The record, already cut to its start sample.
    seed : int
        Seed of the run, above 0.

    Raises
    ------
    ValueError
        The protocol has another engine than "2021" and "cma", or see `search.check_settings` and `misfit.fold`.
    """
    if protocol.engine not in ("2021", "cma"):
        raise ValueError(f"engine {protocol.engine!r}: expected '2021' or 'cma'")
    if protocol.rpm:
        return _fit_in_rpm(recording, protocol, seed)
    if protocol.engine == "cma":
        return _library_fit(recording, protocol, seed)
    found = paper_run(recording, protocol, seed)
    return Fit(found.best, found.misfit, found.evaluations, len(found.history))


def _fit_in_rpm(recording: Recording, protocol: Protocol, seed: int) -> Fit:
    """Fit 60 (v - mean v), and give A, v_t and the misfit in rps."""
    mean = recording.v.mean()
    in_rpm = replace(recording, v=RPM_PER_RPS * (recording.v - mean))
    fit = paper_fit(in_rpm, replace(protocol, rpm=False), seed)
    X = fit.X.copy()
    X[0] /= RPM_PER_RPS
    X[4] = mean + X[4] / RPM_PER_RPS
    return replace(fit, X=X, rmse=fit.rmse / RPM_PER_RPS)


def library_search(
    recording: Recording, protocol: Protocol, seed: int
) -> "cma.CMAEvolutionStrategy":
    """Today's `cma` on a record, without its slow bound handling: put its samples `into_box`.

    Tell it its own samples with `check_points=False`: it keeps no archive to know them by. The
    random numbers are those of cma's `seed` option, from a generator of their own.
    """
    import cma  # brings matplotlib, a second that no other engine needs
    from cma.evolution_strategy import get_CMASolutionDict

    box = protocol_box(recording, protocol)
    check_settings(box, protocol.population, protocol.iterations, seed)
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
    # The archive of samples serves cma's own bounds and injected solutions; keeping it costs a
    # third of a run.
    strategy.sent_solutions = get_CMASolutionDict(False)()
    return strategy


def _library_fit(recording: Recording, protocol: Protocol, seed: int) -> Fit:
    record = fold(recording.t, recording.v, protocol.timing)
    box = protocol_box(recording, protocol)
    strategy = library_search(recording, protocol, seed)
    while not strategy.stop():
        samples = strategy.ask()
        members = into_box(np.array(samples), box, margin_today)
        strategy.tell(samples, folded_rmse(members, record), check_points=False)
    best = into_box(strategy.best.x[None], box, margin_today)[0]
    return Fit(best, float(strategy.best.f), strategy.countevals, strategy.countiter)
