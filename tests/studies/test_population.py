"""Logs of joints that nobody calibrated, and what is said of the methods that measured them."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from backlash.studies import population
from backlash.studies.benchmark import summarise_intervals
from replication.standins.joints import draw_bench, encoder_log

NEAR, FAR = population.SPREADS


def measured(size: int = 4000, shift: float = 0.0, scale: float = 1.0) -> pd.DataFrame:
    """Rows of a method whose errors are normal with SD 1e-5 rad but for a shift and a scale in SDs."""
    rng = np.random.default_rng(1)
    delta = rng.uniform(3e-4, 2e-3, size)
    found = delta + 1e-5 * (shift + scale * rng.standard_normal(size))
    half = population.NORMAL_95 * 1e-5
    return pd.DataFrame(
        {"population": NEAR, "method": "self", "delta_rad": delta, "found_rad": found, "low_rad": found - half,
         "high_rad": found + half, "bound_rad": 1e-5, "refused": False}
    )  # fmt: skip


def test_a_log_is_drawn_again_alike():
    one, two, other = (population.draw_log(NEAR, number, 7) for number in (3, 3, 4))
    assert np.array_equal(one.recording.v, two.recording.v)
    assert one.labels == two.labels
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
    bounds = np.array([log.labels["bound_rad"] for log in population.authors_logs()])
    bar = next(
        bar for name, figure, _, bar in population.ACCEPTANCE_CRITERIA if name == "authors' logs" and "error" in figure
    )
    assert bounds.size == 18
    assert np.sqrt(2 / np.pi) * bounds.mean() > bar


def test_ranks_are_uniform_where_the_intervals_are_right_and_only_there():
    assert population.rank_uniformity_p(measured()) > 0.01
    assert population.rank_uniformity_p(measured(shift=0.15)) < 0.01
    assert population.rank_uniformity_p(measured(scale=1.3)) < 0.01


def test_coverage_is_the_share_of_intervals_that_hold():
    summary = summarise_intervals(measured()).iloc[0]
    assert summary["coverage"] == pytest.approx(0.95, abs=0.015)
    assert summary["coverage_low"] < summary["coverage"] < summary["coverage_high"]
    assert summary["rmse_rad"] == pytest.approx(1e-5, rel=0.05)


def test_a_bar_is_met_or_missed_by_what_was_measured():
    good, bad = (population.against_criteria(summarise_intervals(measured(scale=scale))) for scale in (1.0, 5.0))
    met = good.set_index("figure")["met"]
    assert met["rmse_rad"]
    assert met["rmse_over_bound"]
    assert not bad.set_index("figure").loc["rmse_over_bound", "met"]


def test_the_turns_of_the_papers_kind_of_bench_settle_and_those_of_one_that_hardly_damps_do_not():
    assert population.turn_change_rps(NEAR, 0, 7) < 1e-6
    assert population.turn_change_rps(FAR, 54, 20262) > 1e-2
