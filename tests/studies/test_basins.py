from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from replication.identify import Protocol, paper_fit, protocol_box
from replication.signature import rmse
from studies import basins, optimizers
from tests.conftest import TRUE_X
from tests.tools.timings import reference_fit


def made_runs(seed, runs, rows=(1, 2, 3), shift=0.0):
    generator = np.random.default_rng(seed)
    A = generator.choice([0.5, 0.55], (len(rows), runs), p=[0.6, 0.4]) * (1 + shift)
    parts = [
        pd.DataFrame(
            {"row": row, "A_rps": a, "rmse_rps": np.where(a < 0.525 * (1 + shift), 0.05, 0.06)}
        )
        for row, a in zip(rows, A, strict=True)
    ]
    return pd.concat(parts, ignore_index=True)


def test_sets_of_one_search_lie_apart_by_no_more_than_chance_and_a_shifted_set_by_more():
    sets = {
        "first": made_runs(1, 30),
        "same": made_runs(2, 30),
        "shifted": made_runs(3, 30, shift=0.1),
    }
    table = basins.compare_searches(sets).set_index("search")
    assert np.isnan(table.loc["first", "shift_percent"])
    same, shifted = table.loc["same"], table.loc["shifted"]
    assert same["shift_low_percent"] < 0 < same["shift_high_percent"]
    assert same["chance_low_percent"] < same["apart_percent"] < same["chance_high_percent"]
    assert shifted["shift_low_percent"] < 10 < shifted["shift_high_percent"]
    assert shifted["shift_low_percent"] > 5
    assert shifted["apart_percent"] > shifted["chance_high_percent"]
    assert shifted["best_shift_percent"] == pytest.approx(10)
    assert (table["runs"] == 90).all()


def test_a_set_on_fewer_records_is_compared_on_those_alone():
    sets = {"first": made_runs(1, 30), "few": made_runs(2, 12, rows=(2,))}
    few = basins.compare_searches(sets).set_index("search").loc["few"]
    assert (few["records"], few["runs"]) == (1, 12)
    assert few["first_rate"] == (sets["first"].query("row == 2")["rmse_rps"] == 0.05).mean()


def test_more_runs_narrow_what_chance_gives():
    few, many = (
        basins.compare_searches({"first": made_runs(1, runs), "same": made_runs(2, runs)}).iloc[1]
        for runs in (6, 96)
    )
    ratio = few["chance_percent"] / many["chance_percent"]
    assert ratio == pytest.approx(4, rel=0.25)


@pytest.mark.parametrize(
    "strategy",
    [name for name, (kind, _) in optimizers.SEARCH_METHODS.items() if "restarts" in kind],
)
def test_a_strategy_keeps_to_its_budget_and_depends_on_nothing_but_its_seed(made_record, strategy):
    first, second = (optimizers.run_method(strategy, made_record, 0.0, 6000, 3) for _ in range(2))
    assert first == second
    assert 6000 <= first["evaluations"] < 6000 + 1000
    assert not first["found"]


def test_a_search_stops_at_its_target(made_record):
    target = 1.002 * rmse(made_record.t, made_record.v, TRUE_X, Protocol().timing)
    strategy = "A and v_t projected out, population 30, restarted"
    results = [
        optimizers.run_method(strategy, made_record, target, 60000, seed) for seed in range(1, 4)
    ]
    assert all(result["found"] for result in results)


def the_middle(misfit, lower, upper, evaluations, seed):
    """An optimiser that tries too large an A and the middle of the box, and returns the lower bounds."""
    assert misfit(np.append(10 * upper[0], upper[1:])) == misfit(upper)
    misfit((lower + upper) / 2)
    return lower


def test_a_function_is_an_optimiser_and_what_it_returns_is_evaluated_too(made_record):
    run = optimizers.run_method(the_middle, made_record, 0.0, 6000, 1)
    assert (run["method"], run["kind"], run["evaluations"], run["found"]) == (
        "the_middle",
        "function",
        4,
        False,
    )
    box = protocol_box(made_record, Protocol())
    tried = (box.upper, (box.lower + box.upper) / 2, box.lower)
    misfits = [rmse(made_record.t, made_record.v, X, Protocol().timing) for X in tried]
    assert run["rmse_rps"] == pytest.approx(min(misfits), rel=1e-9)
    target = 1.1 * rmse(made_record.t, made_record.v, TRUE_X, Protocol().timing)
    assert optimizers.run_method(lambda *_: TRUE_X, made_record, target, 6000, 1)["found"]


def test_the_reference_fit_samples_like_the_fast_one(made_record):
    short = replace(Protocol(), population=20, iterations=3, engine="cma")
    fast = paper_fit(made_record, short, seed=2).rmse
    assert reference_fit(made_record, short, seed=2).rmse == pytest.approx(fast, rel=1e-9)
