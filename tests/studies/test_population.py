"""Logs of joints that nobody calibrated, and what is said of the methods that measured them."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from replication.files import ROOT
from replication.standins import draw_bench, encoder_log
from studies import population
from studies.benchmark import summarise_intervals

NEAR = population.NEAR


def measured(size: int = 4000) -> pd.DataFrame:
    """Rows of a method whose errors are normal with SD 1e-5 rad."""
    rng = np.random.default_rng(1)
    delta = rng.uniform(3e-4, 2e-3, size)
    found = delta + 1e-5 * rng.standard_normal(size)
    half = population.NORMAL_95 * 1e-5
    rows = {
        "delta_rad": delta,
        "found_rad": found,
        "low_rad": found - half,
        "high_rad": found + half,
    }
    return pd.DataFrame(rows).assign(population=NEAR, method="self", bound_rad=1e-5, refused=False)


def test_a_log_is_drawn_again_alike():
    one, two, other = (population.draw_log(NEAR, number, 7) for number in (3, 3, 4))
    assert np.array_equal(one.recording.v, two.recording.v)
    assert one.bound_rad == two.bound_rad
    assert not np.array_equal(one.recording.v, other.recording.v)


def test_the_bound_grows_with_the_noise():
    rng = np.random.default_rng(2)
    bench = draw_bench(rng)
    log = encoder_log(bench, 1e-3, rng)
    loud = replace(bench, noise_rps=2 * bench.noise_rps)
    once, twice = (population.bench_bound_rad(each, 1e-3, log) for each in (bench, loud))
    assert twice == pytest.approx(2 * once)


@pytest.mark.slow
def test_the_authors_logs_have_a_bound_above_the_bar_on_their_error(authors_data):
    logs = [population.draw_log(population.AUTHORS, number, 0) for number in range(18)]
    bounds = np.array([log.bound_rad for log in logs])
    bars = pd.read_csv(population.CRITERIA).set_index(["population", "figure"])["limit"]
    bar = bars[population.AUTHORS, "mean_abs_error_rad"]
    assert np.sqrt(2 / np.pi) * bounds.mean() > bar


def test_coverage_is_the_share_of_intervals_that_hold():
    summary = summarise_intervals(measured()).iloc[0]
    assert summary["coverage"] == pytest.approx(0.95, abs=0.015)
    assert summary["coverage_low"] < summary["coverage"] < summary["coverage_high"]
    assert summary["rmse_rad"] == pytest.approx(1e-5, rel=0.05)


# -------------------------------------------------------------------------------------------------- the committed logs


@pytest.fixture(scope="module")
def committed():
    """Rows of method "self" on the committed logs."""
    return pd.read_csv(ROOT / "results" / "population_logs.csv").query("method == 'self'")


@pytest.mark.slow
def test_committed_logs_drawn_at_random_are_measured_the_same_again(committed):
    kept = (
        committed[committed["population"] == NEAR].sample(4, random_state=3).sort_values("number")
    )
    again = population.measure_population(
        NEAR, list(kept["number"]), population.FINAL_SEED, ("self",)
    )
    difference = np.abs(again["found_rad"].to_numpy() - kept["found_rad"].to_numpy())
    assert (difference < 0.1 * kept["sd_rad"].to_numpy()).all()
