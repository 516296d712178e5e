"""From a record to the signature's parameters: the paper's CMA-ES."""

from collections.abc import Callable
from dataclasses import dataclass

import cma
import numba
import numpy as np
from cma.evolution_strategy import get_CMASolutionDict
from numpy.typing import NDArray

from replication.compiled.misfit import population_rmse
from replication.datasets import Recording
from replication.signature import DAMPING_PER_S, FREQUENCY_HZ, Box, Timing, table1_box

FloatArray = NDArray[np.float64]


def margin_cma3(bound: FloatArray) -> FloatArray:
    """Width of the curved margin at a bound in cma before 3.4, which the authors' seeds belong to."""
    return (1 + np.abs(bound)) / 20


def margin_cma4(bound: FloatArray) -> FloatArray:
    """Width of the curved margin at a bound in cma from 3.4 on."""
    return np.maximum(1, np.abs(bound)) / 20


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
    margin : callable
        Width of the bound transformation's margin.
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
    margin: Callable[[FloatArray], FloatArray] = margin_cma3

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


@numba.njit(cache=True)
def _into_box(genotypes, lower, upper, lower_margin, upper_margin):
    """Compiled body of `into_box`: the arithmetic of cma's BoxConstraintsLinQuadTransformation."""
    phenotypes = np.empty_like(genotypes)
    for p in range(genotypes.shape[0]):
        for i in range(genotypes.shape[1]):
            y = genotypes[p, i]
            lb, ub, al, au = lower[i], upper[i], lower_margin[i], upper_margin[i]
            start = lb - 2 * al - (ub - lb) / 2.0
            if y < start or y > ub + 2 * au + (ub - lb) / 2.0:
                period = 2 * (ub - lb + al + au)
                y -= period * ((y - start) // period)
            if y > ub + au:
                y -= 2 * (y - ub - au)
            if y < lb - al:
                y += 2 * (lb - al - y)
            if y < lb + al:
                y = lb + (y - (lb - al)) ** 2 / 4 / al
            if y > ub - au:
                y = ub - (y - (ub + au)) ** 2 / 4 / au
            phenotypes[p, i] = y
    return phenotypes


def into_box(genotypes: FloatArray, box: Box, margin: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Map a whole population into the box, each member exactly as cma's own bound handling would.

    Parameters
    ----------
    genotypes : array of shape (members, parameters)
        Unbounded samples.
    box : Box
        Where they have to be.
    margin : callable
        Width of the curved margin at a bound.

    Returns
    -------
    array of shape (members, parameters)
    """
    return _into_box(np.ascontiguousarray(genotypes), box.lower, box.upper, *_margins(box, margin))


def _margins(box: Box, margin: Callable[[FloatArray], FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Widths of the curved margins at the lower and upper bounds; at most half the box."""
    half = (box.upper - box.lower) / 2
    return np.minimum(half, margin(box.lower)), np.minimum(half, margin(box.upper))


def _middle_genotype(box: Box, margin: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Genotype of the box's middle, which may lie in a margin: the inverse of `into_box` there."""
    middle = (box.lower + box.upper) / 2
    al, au = _margins(box, margin)
    near_lower = (box.lower - al) + 2 * (al * (middle - box.lower)) ** 0.5
    near_upper = (box.upper + au) - 2 * (au * (box.upper - middle)) ** 0.5
    inner = np.where(middle < box.upper - au, middle, near_upper)
    return np.where(middle < box.lower + al, near_lower, inner)


def protocol_box(recording: Recording, protocol: Protocol) -> Box:
    """Table 1's box for a record, as the protocol widens it."""
    p = protocol
    return table1_box(recording.t, recording.v, p.longest_window_s, p.amplitude_factor, p.damping_per_s, p.frequency_hz)


def evolution_strategy(box: Box, protocol: Protocol, seed: int) -> cma.CMAEvolutionStrategy:
    """Make the paper's CMA-ES for a box, without cma's slow bound handling (see `into_box`).

    Tell it its own samples with `check_points=False`: it keeps no archive to know them by. The
    random numbers are those of cma's `seed` option, from a generator of their own.

    Parameters
    ----------
    box : Box
        Bounds.
    protocol : Protocol
        Population, iterations and margin.
    seed : int
        Seed of the run, above 0 (cma takes 0 for "from the clock").

    Returns
    -------
    cma.CMAEvolutionStrategy

    Raises
    ------
    ValueError
        The seed is not above 0.
    """
    if seed <= 0:
        raise ValueError(f"seed {seed}: cma needs a seed above 0")
    width = box.upper - box.lower
    options = {
        "popsize": protocol.population,
        "maxiter": protocol.iterations,
        "CMA_stds": width / 4,
        "maxstd": width * (1 / 3),  # what cma sets for a bounded problem
        "seed": np.nan,  # leave NumPy's global generator alone
        "randn": np.random.RandomState(seed).randn,
        "verbose": -9,
        "verb_disp": 0,
        "verb_log": 0,
    }
    strategy = cma.CMAEvolutionStrategy(_middle_genotype(box, protocol.margin), 1.0, options)
    # The archive of samples serves cma's own bounds and injected solutions; keeping it costs a third of a run.
    strategy.sent_solutions = get_CMASolutionDict(False)()
    return strategy


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
    """
    box = protocol_box(recording, protocol)
    strategy = evolution_strategy(box, protocol, seed)
    while not strategy.stop():
        genotypes = strategy.ask()
        strategy.tell(genotypes, _misfits(genotypes, recording, box, protocol), check_points=False)
    best = into_box(np.atleast_2d(strategy.best.x), box, protocol.margin)[0]
    return Fit(best, float(strategy.best.f), strategy.countevals, strategy.countiter)


def first_generation_rmse(recording: Recording, protocol: Protocol, seed: int) -> float:
    """Lowest misfit [rps] of a run's first generation, which depends on nothing but the seed and the box."""
    box = protocol_box(recording, protocol)
    genotypes = evolution_strategy(box, protocol, seed).ask()
    return float(_misfits(genotypes, recording, box, protocol).min())


def _misfits(genotypes: list[FloatArray], recording: Recording, box: Box, protocol: Protocol) -> FloatArray:
    population = into_box(np.array(genotypes), box, protocol.margin)
    return population_rmse(recording.t, recording.v, population, protocol.timing)
