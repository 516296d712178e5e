"""How unbounded samples get into a box, as in the library `cma`.

The identity inside, bent to a half-parabola in a margin at each bound; beyond the margins the map
goes back and forth.
"""

from collections.abc import Callable

import numpy as np

from replication.arrays import FloatArray
from replication.compiled.cache import njit
from replication.signature import Box

Margin = Callable[[FloatArray], FloatArray]


def margin_2021(bound: FloatArray) -> FloatArray:
    """Width of the margin at a bound in cma before 3.4, which the authors' seeds belong to."""
    return (1 + np.abs(bound)) / 20


def margin_today(bound: FloatArray) -> FloatArray:
    """Width of the margin at a bound in cma from 3.4 on."""
    return np.maximum(1, np.abs(bound)) / 20


def into_box(samples: FloatArray, box: Box, margin: Margin = margin_2021) -> FloatArray:
    """Map a population of unbounded samples, shape (members, parameters), into the box."""
    return bend_into(samples, box.lower, box.upper, *margins_of(box, margin))


def from_box(point: FloatArray, box: Box, margin: Margin = margin_2021) -> FloatArray:
    """Sample whose image under `into_box` is a point of the box."""
    lower_margin, upper_margin = margins_of(box, margin)
    near_lower = (box.lower - lower_margin) + 2 * (lower_margin * (point - box.lower)) ** 0.5
    near_upper = (box.upper + upper_margin) - 2 * (upper_margin * (box.upper - point)) ** 0.5
    inner = np.where(point < box.upper - upper_margin, point, near_upper)
    return np.where(point < box.lower + lower_margin, near_lower, inner)


def margins_of(box: Box, margin: Margin = margin_2021) -> tuple[FloatArray, FloatArray]:
    """Widths of the margins at the lower and upper bounds, never more than half the box."""
    half = (box.upper - box.lower) / 2
    return np.minimum(half, margin(box.lower)), np.minimum(half, margin(box.upper))


@njit
def bend_into(samples, lower, upper, lower_margin, upper_margin):
    """Compiled body of `into_box`, in the library's order of operations."""
    members = np.empty_like(samples)
    for i in range(samples.shape[1]):
        lb, ub = lower[i], upper[i]
        al, au = lower_margin[i], upper_margin[i]
        start = lb - 2 * al - (ub - lb) / 2.0
        end = ub + 2 * au + (ub - lb) / 2.0
        for p in range(samples.shape[0]):
            y = samples[p, i]
            if y < start or y > end:
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
            members[p, i] = y
    return members
