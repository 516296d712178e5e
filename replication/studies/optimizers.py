"""CMA-ES against swarm algorithms and classical methods, with equal function evaluations.

The swarms are NiaPy's (the optional extra `studies`), the classical methods SciPy's. All minimise the paper's cost in
the box of the authors' notebook, and stop when they find the best basin or have spent the budget.
"""

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from itertools import count

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy import optimize, stats

from replication.arrays import FloatArray
from replication.compiled.misfit import population_rmse, residual
from replication.datasets import Recording, load_noisy
from replication.global_fit.fit import global_fit
from replication.identify import Protocol, protocol_box
from replication.search import generations, stop_rule
from replication.statistics import rate_columns
from replication.table2 import BASIN_GAP, table2_levels

# What the authors' notebook spends: 300 members in 200 generations.
BUDGET = 60_000
POPULATION = 300
RUNS_PER_RECORD = 10
LEVELS = (2, 6, 11)  # Table 2's first, middle and last row, realisation R = 1
SWARMS = {
    "particle swarm": "ParticleSwarmAlgorithm",
    "artificial bee colony": "ArtificialBeeColonyAlgorithm",
    "grey wolf": "GreyWolfOptimizer",
    "bat": "BatAlgorithm",
}


class SearchEnded(Exception):
    """The budget is spent, or the best basin found."""


class Cost:
    """The paper's cost over the unit cube, counting evaluations; raises `SearchEnded` when there is no more to do."""

    def __init__(self, recording: Recording, target_rmse: float, budget: int):
        protocol = Protocol()
        self.recording, self.target, self.budget = recording, target_rmse, budget
        self.box, self.timing = protocol_box(recording, protocol), protocol.timing
        self.best, self.evaluations = math.inf, 0

    def of_members(self, X: FloatArray) -> FloatArray:
        """Misfits [rps] of a population of shape (members, 7), in the box's own units."""
        misfits = population_rmse(self.recording.t, self.recording.v, X, self.timing)
        self._count(float(misfits.min()), misfits.size)
        return misfits

    def __call__(self, unit: FloatArray) -> float:
        """Misfit [rps] at a point of the unit cube."""
        return float(self.of_members(self._in_box(unit)[None])[0])

    def residuals(self, unit: FloatArray) -> FloatArray:
        """Residuals over the root of their number, whose norm is the misfit: what least squares takes."""
        found = residual(self.recording.t, self.recording.v, self._in_box(unit), self.timing)
        found /= math.sqrt(found.size)
        self._count(math.sqrt(found @ found), 1)
        return found

    def _in_box(self, unit: FloatArray) -> FloatArray:
        return self.box.lower + np.clip(unit, 0.0, 1.0) * (self.box.upper - self.box.lower)

    def _count(self, misfit: float, evaluations: int) -> None:
        self.evaluations += evaluations
        self.best = min(self.best, misfit)
        if self.best <= self.target or self.evaluations >= self.budget:
            raise SearchEnded


def _covariance(populations: Callable[[], Iterator[int]]) -> Callable[[Cost, int], None]:
    """CMA-ES with each population in turn, until its stop rule or the end."""

    def run(cost: Cost, seed: int) -> None:
        generator = np.random.default_rng(seed)
        for population in populations():
            first, history = None, []
            normals = lambda *shape: generator.standard_normal(shape)  # noqa: E731
            for now in generations(cost.of_members, cost.box, normals, population):
                first = first or now
                ranked = now.misfits[now.ranking]
                history.append((ranked[0], np.median(ranked), ranked[int(0.75 * ranked.size)]))
                if stop_rule(now, first, np.array(history), iterations=cost.budget):
                    break

    return run


def default_population(parameters: int = 7) -> int:
    """CMA-ES's own population for a number of parameters: 4 + 3 ln n, rounded down."""
    return 4 + int(3 * math.log(parameters))


def _swarm(algorithm: str, population: int | None) -> Callable[[Cost, int], None]:
    """One of NiaPy's swarms, its settings but for the population left alone."""

    def run(cost: Cost, seed: int) -> None:
        from niapy.algorithms import basic
        from niapy.problems import Problem
        from niapy.task import Task

        class UnitCube(Problem):
            def _evaluate(self, x: FloatArray) -> float:
                return cost(x)

        settings = {} if population is None else {"population_size": population}
        getattr(basic, algorithm)(seed=seed, **settings).run(Task(UnitCube(cost.box.lower.size, 0.0, 1.0)))

    return run


def _restarted(descend: Callable[[Cost, FloatArray], object]) -> Callable[[Cost, int], None]:
    """A local method from random points of the box, over and over."""

    def run(cost: Cost, seed: int) -> None:
        generator = np.random.default_rng(seed)
        while True:
            descend(cost, generator.random(cost.box.lower.size))

    return run


def _least_squares(cost: Cost, start: FloatArray) -> object:
    return optimize.least_squares(cost.residuals, start, bounds=(0, 1))


def _minimize(method: str) -> Callable[[Cost, FloatArray], object]:
    """One of SciPy's local methods."""
    return lambda cost, start: optimize.minimize(cost, start, method=method, bounds=[(0, 1)] * start.size)


def _rectangles(cost: Cost, seed: int) -> None:
    optimize.direct(cost, [(0, 1)] * cost.box.lower.size, maxfun=2 * cost.budget, maxiter=cost.budget, vol_tol=0)


OPTIMIZERS: dict[str, tuple[str, Callable[[Cost, int], None]]] = {
    "CMA-ES, population 300": ("CMA-ES", _covariance(lambda: iter([POPULATION]))),
    "CMA-ES, its own population": ("CMA-ES", _covariance(lambda: iter([default_population()]))),
    "CMA-ES, its own population, restarts doubling it": (
        "CMA-ES",
        _covariance(lambda: (default_population() * 2**k for k in count())),
    ),
    **{f"{name}, population 300": ("swarm", _swarm(algorithm, POPULATION)) for name, algorithm in SWARMS.items()},
    **{f"{name}, its own population": ("swarm", _swarm(algorithm, None)) for name, algorithm in SWARMS.items()},
    "least squares, restarted": ("classical", _restarted(_least_squares)),
    "L-BFGS-B, restarted": ("classical", _restarted(_minimize("L-BFGS-B"))),
    "Nelder-Mead, restarted": ("classical", _restarted(_minimize("Nelder-Mead"))),
    "DIRECT": ("deterministic", _rectangles),
}


def swarms_installed() -> bool:
    """Whether the optional extra `studies` is there."""
    return find_spec("niapy") is not None


def run_method(method: str, level: int, realisation: int, seed: int, budget: int = BUDGET) -> dict:
    """Let a method look for a record's best basin: found within `BASIN_GAP` of the global fit's misfit."""
    recording = load_noisy(level, realisation)
    best = global_fit(recording).rmse
    kind, run = OPTIMIZERS[method]
    cost = Cost(recording, best * (1 + BASIN_GAP), budget)
    with contextlib.suppress(SearchEnded):
        run(cost, seed)
    run_key = {"method": method, "kind": kind, "level": level, "realisation": realisation, "seed": seed}
    outcome = {"found": cost.best <= cost.target, "rmse_over_best": cost.best / best}
    return run_key | outcome | {"evaluations": min(cost.evaluations, budget)}


def plan(methods: Sequence[str] = tuple(OPTIMIZERS), runs: int = RUNS_PER_RECORD) -> list[tuple[str, int, int, int]]:
    """Every run of the comparison: method, level, realisation, seed. A deterministic method gets more records."""
    jobs = []
    for method in methods:
        if OPTIMIZERS[method][0] == "deterministic":
            jobs += [(method, level, realisation, 0) for realisation in (1, 2) for level in table2_levels()]
        else:
            jobs += [(method, level, 1, seed) for level in LEVELS for seed in range(1, runs + 1)]
    return jobs


def run_all(jobs: Sequence[tuple[str, int, int, int]], n_jobs: int = -1) -> pd.DataFrame:
    """Run methods side by side; one row a run, as `run_method` gives it."""
    return pd.DataFrame(Parallel(n_jobs=n_jobs)(delayed(run_method)(*job) for job in jobs))


def success_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Rate at which each method finds the best basin, its interval, and evaluations per success."""
    rows = []
    for (method, kind), part in runs.groupby(["method", "kind"], sort=False):
        found = int(part["found"].sum())
        records = part.groupby(["level", "realisation"]).ngroups
        rows.append(
            {"method": method, "kind": kind, "records": records, "runs": len(part), "found": found}
            | rate_columns(found, len(part))
            | {"evaluations_per_success": part["evaluations"].sum() / found if found else np.inf}
        )
    return pd.DataFrame(rows)


def against_swarms(table: pd.DataFrame) -> pd.DataFrame:
    """CMA-ES with the authors' population against each swarm at its better population: one-sided p-values of Fisher."""
    ours = table.set_index("method").loc["CMA-ES, population 300"]
    rows = []
    for swarm in SWARMS:
        theirs = table[table["method"].str.startswith(f"{swarm},")].sort_values("rate", kind="stable").iloc[-1]
        counts = [[row["found"], row["runs"] - row["found"]] for row in (ours, theirs)]
        p_values = [stats.fisher_exact(counts, alternative=side).pvalue for side in ("greater", "less")]
        rows.append((swarm, theirs["method"], theirs["rate"], *p_values))
    return pd.DataFrame(rows, columns=["swarm", "method", "rate", "p_cma_better", "p_swarm_better"])
