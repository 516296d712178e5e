"""Whole runs of the search, compiled: `search.generations` and `search.search` in one, bit by bit."""

import numpy as np

from replication.compiled.bounds import bend_into, margins_of
from replication.compiled.cache import njit
from replication.compiled.misfit import FoldedRecord, folded_rmse
from replication.search import (
    HISTORY,
    Search,
    check_settings,
    constants,
    decompose,
    first_state,
    history_row,
    sample,
    stop_rule,
    update,
)
from replication.signature import Box


def whole_run(
    record: FoldedRecord, box: Box, seed: int, population: int, iterations: int
) -> Search:
    """Search a folded record as `search.search` does with `random_normals(seed)`."""
    check_settings(box, population, iterations, seed)
    c = constants(population, box.lower.size)
    bounds = (box.lower, box.upper, *margins_of(box))
    history = np.empty((iterations, len(HISTORY)))
    best, misfit, stop, generations = _run(record, bounds, first_state(box, 1.0), c, seed, history)
    return Search(best, misfit, population * generations, stop, history[:generations].copy())


@njit
def _run(record, bounds, start, c, seed, history):
    """Compiled body of `whole_run`; fills the history."""
    np.random.seed(seed)  # noqa: NPY002  Numba's own generator: the same numbers as `random_normals`
    best, misfit = start.m, np.inf
    stop = ""
    after = start
    while stop == "":
        before = decompose(after)
        x = sample(before, np.random.standard_normal((c.weights.size, c.n)))  # noqa: NPY002
        members = bend_into(x, *bounds)
        misfits = folded_rmse(members, record)
        ranking = np.argsort(misfits, kind="mergesort")
        after = update(before, x[ranking], c)
        ranked = misfits[ranking]
        history[after.g - 1] = history_row(ranked, after)
        if ranked[0] < misfit:
            best, misfit = members[ranking[0]].copy(), ranked[0]
        stop = stop_rule(history[: after.g], ranked, after, start.sigma)
        stop = "maxiter" if after.g == len(history) else stop
    return best, misfit, stop, after.g
