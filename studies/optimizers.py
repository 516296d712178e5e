"""CMA-ES against swarm algorithms and classical methods.

The swarms are NiaPy's, the classical methods SciPy's: as they come, from one start, from fifty, or restarted at random,
and one that is prepared. All minimise the paper's cost in the box of the authors' notebook, and stop when they find the
best basin, have spent the budget, or know no more.
"""

import contextlib
import math
from collections.abc import Callable
from functools import partial
from itertools import count, product
from operator import attrgetter
from typing import Any

import numpy as np
from pandas import DataFrame
from scipy import optimize, stats

from replication import misfit
from replication.best_fit import best_fit
from replication.cmaes import generations, search
from replication.records import LOW_NOISE, Recording, load_noisy
from replication.signature import FloatArray, Parameters, h
from replication.table2 import BASIN_GAP, LEVELS, NOTEBOOK, search_box

# What the authors' notebook spends: 300 members in 200 generations.
POPULATION = 300
BUDGET = 60_000
OWN_POPULATION = 4 + int(3 * math.log(7))  # what CMA-ES takes by itself for seven parameters
RUNS_PER_RECORD = 10
SEARCHED_LEVELS = (2, 6, 11)  # Table 2's first, middle and last row, realisation R = 1
SWARMS = {
    "particle swarm": "ParticleSwarmAlgorithm",
    "artificial bee colony": "ArtificialBeeColonyAlgorithm",
    "grey wolf": "GreyWolfOptimizer",
    "bat": "BatAlgorithm",
}


class SearchEnded(Exception):
    """The budget is spent, or the best basin found."""


class Cost:
    """The paper's cost, counting evaluations; raises `SearchEnded` when there is no more to do."""

    def __init__(self, recording: Recording, target: float, budget: int):
        self.target = target
        self.budget = budget
        self.box = search_box(recording, NOTEBOOK)
        self.best = math.inf
        self.evaluations = 0
        self._misfits = misfit.cost(recording.t, recording.v, NOTEBOOK.timing)
        self._folded = misfit.fold(recording.t, recording.v, NOTEBOOK.timing)
        self._recording = recording

    def of_members(self, X: FloatArray) -> FloatArray:
        """Misfits [rps] of a population of shape (members, parameters), in the box's own units."""
        return self._count(self._misfits(X))

    def of_shapes(self, unit: FloatArray) -> FloatArray:
        """Least misfits over A and v_t of shapes (t0, tau, omega, T2, T1) in the unit cube, shape (members, 5)."""
        shapes = self._in_box(unit, misfit.PROJECTED)
        return self._count(misfit.project(shapes, self._folded, self.box.upper[0])[1])

    def __call__(self, unit: FloatArray) -> float:
        """Misfit [rps] at a point of the unit cube."""
        return float(self.of_members(self._in_box(unit)[None])[0])

    def residuals(self, unit: FloatArray) -> FloatArray:
        """Residuals over the root of their number: their norm is the misfit."""
        t, v = self._recording.t, self._recording.v
        X = Parameters(*self._in_box(unit))
        residuals = (v - X.v_t - h(t, X, NOTEBOOK.timing)) / math.sqrt(v.size)
        self._count(np.sqrt([residuals @ residuals]))
        return residuals

    def _in_box(self, unit: FloatArray, part: Any = slice(None)) -> FloatArray:
        lower, upper = self.box.lower[part], self.box.upper[part]
        return lower + np.clip(unit, 0.0, 1.0) * (upper - lower)

    def _count(self, misfits: FloatArray) -> FloatArray:
        self.evaluations += misfits.size
        self.best = min(self.best, float(misfits.min()))
        if self.best <= self.target or self.evaluations >= self.budget:
            raise SearchEnded
        return misfits


# A way to search: spends a cost with a seed; and a local method, from a point of the unit cube.
Method = Callable[[Cost, int], None]
Descent = Callable[[Cost, FloatArray], Any]


def _covariance(cost: Cost, seed: int, population: int) -> None:
    """CMA-ES from the middle of the box."""
    search(generations(cost.of_members, cost.box, seed, population), cost.budget)


def _doubled_covariance(cost: Cost, seed: int) -> None:
    """CMA-ES whose restarts double the population (Auger and Hansen's IPOP, 2005)."""
    for k in count():
        _covariance(cost, seed + 1000 * k, OWN_POPULATION * 2**k)


def _swarm(cost: Cost, seed: int, algorithm: str, **settings: int) -> None:
    """One of NiaPy's swarms, its settings but for a population left alone."""
    from niapy.algorithms import basic
    from niapy.problems import Problem
    from niapy.task import Task

    class UnitCube(Problem):
        def _evaluate(self, x: FloatArray) -> float:
            return cost(x)

    task = Task(UnitCube(cost.box.lower.size, 0.0, 1.0))
    getattr(basic, algorithm)(seed=seed, **settings).run(task)


def _restarted(cost: Cost, seed: int, descend: Descent) -> None:
    """A local method from random points of the box, over and over."""
    rng = np.random.default_rng(seed)
    while True:
        descend(cost, rng.random(cost.box.lower.size))


def _from_grid(cost: Cost, seed: int, descend: Descent, starts: int) -> None:
    """A local method from starts along t0, every other parameter in the middle of the box."""
    for t0 in (np.arange(starts) + 0.5) / starts:
        middle = np.full(cost.box.lower.size, 0.5)
        middle[1] = t0
        descend(cost, middle)


# Points of the grid in tau, omega, T2 and T1, and in t0 within half a turn, after which the signature repeats with the
# other sign; and first steps from them, as shares of the box.
T0_POINTS, GRID = 40, (2, 16, 4, 4)
STEPS = np.diag([0.001, 0.2, 0.05, 0.1, 0.15])


def _grid_then_simplex(cost: Cost, seed: int) -> None:
    """Blind: a grid with A and v_t solved by least squares, descents from its best points, and again from theirs."""

    def descend(start: FloatArray, steps: FloatArray) -> optimize.OptimizeResult:
        simplex = np.vstack([start, start + steps])
        return optimize.minimize(
            lambda unit: float(cost.of_shapes(unit[None])[0]),
            start,
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "xatol": 1e-5, "fatol": 1e-6, "maxfev": 300},
        )

    half_turn = NOTEBOOK.timing.T_d / (cost.box.upper[1] - cost.box.lower[1])
    axes = [np.linspace(0, half_turn, T0_POINTS, endpoint=False)]
    axes += [(np.arange(points) + 0.5) / points for points in GRID]
    grid = np.array([*product(*axes)])
    parts = np.array_split(grid, len(grid) // POPULATION + 1)
    misfits = np.concatenate([cost.of_shapes(part) for part in parts])
    ends = [descend(start, STEPS) for start in grid[np.argsort(misfits)[:60]]]
    while True:
        ends.sort(key=attrgetter("fun"))
        ends = [descend(end.x, sign * STEPS) for end in ends[:8] for sign in (1, -1)]


def _rectangles(cost: Cost, seed: int) -> None:
    cube = [(0, 1)] * cost.box.lower.size
    optimize.direct(cost, cube, maxfun=2 * cost.budget, maxiter=cost.budget, vol_tol=0)


def _least_squares(cost: Cost, start: FloatArray) -> None:
    optimize.least_squares(cost.residuals, start, bounds=(0, 1))


# By name, what kind each is and how it searches.
RANDOM: dict[str, tuple[str, Method]] = {
    "CMA-ES, population 300": ("CMA-ES", partial(_covariance, population=POPULATION)),
    "CMA-ES, its own population": ("CMA-ES", partial(_covariance, population=OWN_POPULATION)),
    "CMA-ES, its own population, restarts doubling it": ("CMA-ES", _doubled_covariance),
}
for name, algorithm in SWARMS.items():
    swarm = partial(_swarm, algorithm=algorithm, population_size=POPULATION)
    RANDOM[f"{name}, population 300"] = "swarm", swarm
for name, algorithm in SWARMS.items():
    RANDOM[f"{name}, its own population"] = "swarm", partial(_swarm, algorithm=algorithm)
RANDOM["least squares, restarted"] = "classical", partial(_restarted, descend=_least_squares)
# They run once on each of the fifty public records of low noise.
DETERMINISTIC: dict[str, tuple[str, Method]] = {}
for name in ("L-BFGS-B", "Nelder-Mead"):
    descend: Descent = partial(optimize.minimize, method=name, bounds=optimize.Bounds(0, 1))
    RANDOM[f"{name}, restarted"] = "classical", partial(_restarted, descend=descend)
    for starts, number in (("one start", 1), ("fifty starts along t0", 50)):
        search_from = partial(_from_grid, descend=descend, starts=number)
        DETERMINISTIC[f"{name}, {starts}"] = "classical", search_from
DETERMINISTIC["DIRECT"] = "classical", _rectangles
DETERMINISTIC["grid and simplex descents, A and v_t solved"] = "prepared", _grid_then_simplex
SEARCH_METHODS = RANDOM | DETERMINISTIC


def planned_runs() -> list[tuple[str, int, int, int]]:
    """Method, realisation, level and seed of every run. A deterministic method gets more records."""
    jobs = [*product(RANDOM, [1], SEARCHED_LEVELS, range(1, RUNS_PER_RECORD + 1))]
    for method in DETERMINISTIC:
        is_dear = "fifty" in method or method == "DIRECT"
        jobs += product([method], LOW_NOISE[:2] if is_dear else LOW_NOISE, LEVELS, [0])
    return jobs


def run_on_authors_record(method: str, realisation: int, level: int, seed: int) -> dict:
    """A row of `results/optimizers.csv`. Found is the best basin: within `BASIN_GAP` of the best fit's misfit."""
    recording = load_noisy(level, realisation)
    best = best_fit(recording).rmse
    kind, run = SEARCH_METHODS[method]
    cost = Cost(recording, best * (1 + BASIN_GAP), BUDGET)
    with contextlib.suppress(SearchEnded):
        run(cost, seed)
    return {
        "method": method,
        "kind": kind,
        "level": level,
        "realisation": realisation,
        "seed": seed,
        "found": cost.best <= cost.target,
        "rmse_over_best": cost.best / best,
        "evaluations": min(cost.evaluations, BUDGET),
    }


def success_table(runs: DataFrame) -> DataFrame:
    """Rate at which each method finds the best basin, its 95 % interval, and evaluations per success."""
    key = ["method", "kind"]
    of_method = runs.groupby(key, sort=False)
    table = of_method["found"].agg(runs="size", found="sum")
    records = runs.drop_duplicates([*key, "level", "realisation"])
    table.insert(0, "records", records.groupby(key).size())
    table["rate"] = table["found"] / table["runs"]
    table[["rate_low", "rate_high"]] = [  # after Clopper and Pearson
        stats.binomtest(row.found, row.runs).proportion_ci() for row in table.itertuples()
    ]
    table["evaluations_per_success"] = of_method["evaluations"].sum() / table["found"]
    return table.reset_index()


def against_swarms(table: DataFrame) -> DataFrame:
    """CMA-ES, the authors' population, against each swarm at its better one: one-sided p of Fisher."""
    by_rate = table.sort_values("rate", kind="stable").set_index("method")
    ours = by_rate.loc["CMA-ES, population 300"]
    rows = []
    for swarm in SWARMS:
        theirs = by_rate[by_rate.index.str.startswith(f"{swarm},")].iloc[-1]
        counts = [[row["found"], row["runs"] - row["found"]] for row in (ours, theirs)]
        p_better, p_worse = (
            stats.fisher_exact(counts, alternative=side).pvalue for side in ("greater", "less")
        )
        rows.append((swarm, theirs["rate"], ours["rate"], p_better, p_worse))
    columns = ["swarm", "rate", "rate_cma", "p_cma_better", "p_swarm_better"]
    return DataFrame(rows, columns=columns)
