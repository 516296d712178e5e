"""When the search ends: it follows `cmaes.generations` until one of the library's stop rules holds."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from replication.arrays import FloatArray
from replication.cmaes import Generation, State

TOLFUN = 1e-11  # the range of misfits, of a generation and of recent ones, that ends a search
TOLFUNHIST = 1e-12  # the same of recent ones alone
# What a search keeps of each generation.
HISTORY = ("best", "median", "upper_quartile", "sigma", "axis_ratio", "smallest_std", "largest_std")


@dataclass(frozen=True)
class Search:
    """A finished search: its best member, the rule that ended it, and a row of `HISTORY` for each generation."""

    best: FloatArray
    misfit: float
    evaluations: int
    stop: str
    history: FloatArray


def search(steps: Iterator[Generation], iterations: int) -> Search:
    """Follow `generations` until a stop rule holds, `iterations` at the most and at least one."""
    if iterations < 1:
        raise ValueError(f"iterations {iterations}: at least one generation is needed")
    history = np.empty((iterations, len(HISTORY)))
    best, misfit = np.empty(0), math.inf
    first_sigma = math.nan
    for now in steps:
        g = now.after.g
        ranked = now.misfits[now.ranking]
        history[g - 1] = history_row(ranked, now.after)
        if g == 1:
            first_sigma = now.before.sigma
        if ranked[0] < misfit:
            best, misfit = now.members[now.ranking[0]], float(ranked[0])
        stop = (
            "maxiter" if g == iterations else stop_rule(history[:g], ranked, now.after, first_sigma)
        )
        if stop:
            return Search(best, misfit, g * ranked.size, stop, history[:g].copy())
    raise ValueError("the generations ended before a stop rule held")


def history_row(ranked: FloatArray, state: State) -> FloatArray:
    """What `HISTORY` keeps of a generation, from its misfits, the best first, and the next state."""
    size = ranked.size
    median = (ranked[(size - 1) // 2] + ranked[size // 2]) / 2
    std = state.std
    ratio = state.D[-1] / state.D[0]
    quartile = ranked[int(0.75 * size)]
    return np.array([ranked[0], median, quartile, state.sigma, ratio, std.min(), std.max()])


def stop_rule(history: FloatArray, ranked: FloatArray, state: State, first_sigma: float) -> str:
    """Name of the library's stop rule that holds after a generation, or ""; `history` as in `Search`, so far."""
    m, sigma = state.m, state.sigma
    unit = state.unit
    n, g = m.size, state.g
    std = state.std
    recent = history[max(0, g - 10 - 30 * n // ranked.size) :, 0]
    spread = recent.max() - recent.min()
    if ranked[-1] - recent[-1] < TOLFUN and spread < TOLFUN:
        return "tolfun"
    if recent.size > 9 and spread < TOLFUNHIST:
        return "tolfunhist"
    if (std < 1e-11).all() and (sigma * unit * state.p_c < 1e-11).all():
        return "tolx"
    if (std > 1000 * first_sigma * unit).any():
        return "tolfacupx"
    if state.D[-1] > 1e7 * state.D[0]:
        return "tolconditioncov"
    if g > 1 and history[-1, 2] <= history[-1, 0] and history[-2, 2] <= history[-2, 0]:
        return "tolflatfitness"
    part = int(max(int(100 + 100 * n**1.5 / ranked.size) / 10, g // 5 / 10))
    if g // 5 > max(100, 2 * part):
        fifth = history[4::5][::-1]  # every fifth generation, the newest first
        new, old = fifth[:part], fifth[part : 2 * part]
        if (np.median(new[:, :2], axis=0) >= np.median(old[:, :2], axis=0)).all():
            return "tolstagnation"
    if (m == m + 0.2 * std).any():
        return "noeffectcoord"
    k = g % n  # the axis that this generation tries
    if (m == m + 0.1 * sigma * state.D[k] * unit * state.B[:, k]).all():
        return "noeffectaxis"
    return ""
