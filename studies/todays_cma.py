"""Today's `cma` on a record, with its own bounds, to compare with the paper's search as it was in 2021."""

from collections.abc import Callable, Sequence

import cma
import numpy as np

from replication.arrays import FloatArray
from replication.cmaes import random_normals
from replication.records import Recording
from replication.table2 import Fit, SearchSettings, cost, search_box


def fit_with_todays_cma(
    recording: Recording,
    protocol: SearchSettings,
    seed: int,
    misfits: Callable[[FloatArray], Sequence[float] | FloatArray] | None = None,
) -> Fit:
    """Fit as `table2.fit` does, by another search from the same random numbers, with the paper's cost or one given."""
    box = search_box(recording, protocol)
    misfits = misfits or cost(recording, protocol)
    options = {
        "bounds": [box.lower, box.upper],
        "popsize": protocol.population,
        "maxiter": protocol.iterations,
        "CMA_stds": (box.upper - box.lower) / 4,
        "seed": np.nan,  # leave NumPy's global generator alone
        "randn": random_normals(seed),
        "verbose": -9,
        "verb_log": 0,
    }
    strategy = cma.CMAEvolutionStrategy((box.lower + box.upper) / 2, 1.0, options)
    while not strategy.stop():
        members = strategy.ask()
        strategy.tell(members, misfits(np.array(members)))
    best = strategy.best
    return Fit(best.x, float(best.f), strategy.countevals, strategy.countiter)
