"""The printed Table 2 is tested in all choices; a test holds its level, and a sentence follows its number."""

import numpy as np
import pandas as pd
import pytest

from replication.files import ROOT
from replication.table2 import WHOLE
from studies import claims, intervals
from studies import multiverse as evidence
from studies.multiverse import MEAN_DEVIATION, SCORES_OF_MEANS, SCORES_OF_SDS
from studies.realisations import read_realisations
from workbook.judging import decide_all
from workbook.outcomes import as_fact, load_outcomes

KEPT = read_realisations()
MULTIVERSE = pd.read_csv(ROOT / "results" / "table2_multiverse.csv")


def make_tables(tables, *, shared=0.0, rows=10, seed=1):
    """Numbers of tables, shape (rows, tables): an SD of 0.05 about 1 of each, and what its rows share."""
    rng = np.random.default_rng(seed)
    return 1 + 0.05 * rng.normal(size=(rows, tables)) + shared * rng.normal(size=tables)


@pytest.mark.parametrize(("size", "k"), [(39, 1), (79, 2), (320, 8)])
def test_the_prediction_interval_is_of_order_statistics(size, k):
    numbers = np.random.default_rng(1).permutation(np.arange(1.0, size + 1))
    assert intervals.prediction_interval(numbers) == (k, size + 1 - k)
    assert 1 - 2 * k / (size + 1) >= 0.95 > 1 - 2 * (k + 1) / (size + 1)
    assert intervals.prediction_interval(range(38)) == (-np.inf, np.inf)


def test_numbers_inside_are_counted_and_too_few_tables_count_nothing():
    ours = make_tables(39)
    printed = np.median(ours, axis=1, keepdims=True)
    printed[:3] = 2.0
    assert evidence.count_inside(printed, ours) == 7
    assert np.isnan(evidence.count_inside(printed, ours[:, :38]))


def test_squares_and_ranks_are_what_the_report_says():
    logs = np.arange(5.0)
    half = np.diff(np.quantile(logs, [0.16, 0.84])) / 2
    squares = evidence.squared_logs(np.exp([logs]))[0]
    np.testing.assert_allclose(squares, ((logs - 2) / half) ** 2)
    p = [0.4, 0.8, 1, 0.8, 0.4]
    np.testing.assert_allclose(evidence.rank_scores(logs[None])[0], -2 * np.log(p))


ALL_SCORES = {**SCORES_OF_MEANS, **SCORES_OF_SDS}


@pytest.mark.parametrize("score", ALL_SCORES)
def test_p_of_a_whole_table_is_its_rank_among_all(score):
    numbers = make_tables(40, shared=0.1)
    numbers[:, 0] = 3.0
    p = evidence.p_values(ALL_SCORES[score], numbers, by_rows=False)
    sides = 1 + ALL_SCORES[score].two_sided
    assert p[0] == p.min() == sides / 40
    assert sides == 2 or sorted(p * 40) == pytest.approx(range(1, 41))


@pytest.mark.parametrize("score", ALL_SCORES)
def test_p_by_rows_holds_its_level_where_rows_share_nothing_even_for_few_tables(score, monkeypatch):
    """Of 100 printed tables, each one more beside five of ours; ties of a largest error make it hold more."""
    monkeypatch.setattr(evidence, "DRAWS", 2000)
    numbers = make_tables(6 * 100).reshape(10, 100, 6)
    p = [evidence.p_values(ALL_SCORES[score], numbers[:, k], True)[0] for k in range(100)]
    for level in (0.05, 0.5):
        chance = 4 * np.sqrt(level * (1 - level) / 100)
        assert level / 2 - chance < np.mean(np.array(p) < level) < level + chance


def test_where_rows_share_a_start_recombined_tables_reject_true_ones_and_whole_tables_do_not():
    numbers = make_tables(40, shared=0.1)
    score = SCORES_OF_MEANS[MEAN_DEVIATION]
    assert np.mean(evidence.p_values(score, numbers, by_rows=True) < 0.05) > 0.3
    assert np.mean(evidence.p_values(score, numbers, by_rows=False) < 0.05) <= 0.05


def test_the_committed_multiverse_is_made_of_the_committed_realisations():
    made = evidence.make_multiverse(KEPT)
    pd.testing.assert_frame_equal(made, MULTIVERSE, rtol=1e-5, check_dtype=False)


# ------------------------------------------------------------------------------------------------- what is said


def test_what_the_report_says_of_table_2_as_a_whole_is_what_the_kept_realisations_say():
    committed = load_outcomes()["13_settings_of_table2"]["facts"]["multiverse"]
    described = as_fact(evidence.describe_multiverse(KEPT, MULTIVERSE))
    assert described.pop("whole").items() <= committed.pop("whole").items()
    assert described == committed


def set_p(multiverse, start, p, scores=(MEAN_DEVIATION,), numbers=("means", "SDs")):
    chosen = (multiverse["start"] == start) & multiverse["score"].isin(scores)
    chosen &= multiverse["numbers"].isin(numbers)
    return multiverse.assign(p=multiverse["p"].mask(chosen, p))


def decide_random_start(multiverse, criteria=None):
    measured = evidence.measure_random_start(multiverse, criteria)
    return decide_all(claims.write_all({"random_start": measured}), criteria)["random_start"]


@pytest.mark.parametrize(
    ("p_of_table", "p_of_whole", "criteria", "holds"),
    [
        (0.001, 0.5, None, False),
        (0.001, 0.001, None, None),
        (0.2, 0.5, None, None),
        (0.2, 0.001, None, True),
        (0.2, 0.5, {"random_start": 0.3}, False),
    ],
)
def test_a_random_start_is_decided_by_all_its_readings_and_by_ours_of_the_whole_record(
    p_of_table, p_of_whole, criteria, holds
):
    multiverse = MULTIVERSE
    starts = {"per row": 0.001, "per fit": 0.001, "per table": p_of_table, WHOLE: p_of_whole}
    for start, p in starts.items():
        multiverse = set_p(multiverse, start, p)
    assert decide_random_start(multiverse, criteria)[0] is holds


def test_what_excludes_a_reading_is_named():
    table = set_p(MULTIVERSE, "per row", 0.5, ALL_SCORES)
    table = set_p(table, "per row", 0.001, ["largest error", "mean logarithm"])
    table = set_p(table, "per row", 0.001, ["ranks"], ["SDs"])
    table = set_p(table, "per fit", 0.001, ALL_SCORES)
    table = set_p(table, WHOLE, 0.9, ALL_SCORES)
    table = table.assign(least_p=table["least_p"].mask(table["start"] == "per table", 0.02))
    assert {
        start: evidence.name_exclusions(table, start, 0.01) for start in (WHOLE, *evidence.READINGS)
    } == {
        WHOLE: "none of 7 scores",
        "per row": "the means' largest error, the SDs' ranks and mean logarithm",
        "per fit": "all 7 scores",
        "per table": "none, because so few tables give no p below 0.01",
    }


def test_rejections_are_counted_of_the_tests_that_could_reject():
    table = set_p(MULTIVERSE, "per row", 0.5, SCORES_OF_MEANS)
    table = set_p(table, "per row", 0.01, ["squares"])
    assert evidence.count_rejections(table, "per row", "means") == (12, 3)
    together = table["settings"] == evidence.TOGETHER
    few = table.assign(least_p=table["least_p"].mask(together, 0.1))
    assert evidence.count_rejections(few, "per row", "means") == (8, 2)


def test_what_no_committed_fact_says_has_words_too():
    assert evidence.write_rejections(evidence.Rejections(0, 0)) == "too few tables to test"
    assert [evidence.write_p(p) for p in (0.00101, 0.0009)] == ["0.001", "below 0.001"]


def test_intervals_are_described_by_what_lies_inside_and_by_how_wide_they_are():
    rows = pd.DataFrame(
        {
            "mean": [1.0, 2.0],
            "mean_ours": [1.0, 2.0],
            "mean_low": [0.9, 2.1],
            "mean_high": [1.2, 2.5],
            "sd": [0.1, 0.1],
            "sd_ours": [0.2, 0.2],
            "sd_low": [0.2, 0.3],
            "sd_high": [1.0, 0.9],
        },
        index=[4, 7],
    )
    described = evidence.describe_intervals(rows)
    assert described["means"] == {
        "all": 2,
        "agree": 1,
        "differ": [7],
        "width_percent": pytest.approx([20, 30]),
        "factor": pytest.approx([4 / 3, 4 / 3]),
    }
    assert described["sds"]["differ"] == [4, 7]
    assert described["sds"]["factor"] == []
