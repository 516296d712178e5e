"""The printed Table 2 is tested in all choices; a test holds its level, and a sentence follows its number."""

import numpy as np
import pandas as pd
import pytest

from replication import published
from replication.files import ROOT
from replication.table2 import DRAWN, DRAWN_STARTS, NOTEBOOK, SETTINGS, WHOLE
from studies import claims, intervals
from studies import multiverse as evidence
from studies.multiverse import MEAN_DEVIATION, SCORES_OF_MEANS, SCORES_OF_SDS
from studies.realisations import read_realisations
from workbook.judging import decide_all


@pytest.fixture(scope="module")
def kept():
    return read_realisations()


@pytest.fixture(scope="module")
def multiverse():
    return pd.read_csv(ROOT / "results" / "table2_multiverse.csv")


@pytest.fixture
def few_draws(monkeypatch):
    """Fewer recombined tables, where a p need not be known so well."""
    monkeypatch.setattr(evidence, "DRAWS", 2000)


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


def test_the_arranged_tables_are_those_of_the_realisations(kept):
    ours = evidence.arrange_tables(kept[kept["protocol"] == NOTEBOOK.protocol])
    third = kept.query("protocol == @NOTEBOOK.protocol and row == 3").sort_values("realisation")
    theoretical = published.value("table2.row03.theoretical")
    np.testing.assert_allclose(ours.ratios[2], third["mean_A_rps"] / theoretical)
    np.testing.assert_array_equal(ours.sds[2], third["sd_A_rps"])
    printed = evidence.printed_table()
    assert printed.ratios[2, 0] == published.value("table2.row03.mean") / theoretical
    assert printed.sds[9, 0] == published.value("table2.row10.sd")
    assert {name: each.shape for name, each in printed.numbers().items()} == {
        "means": (10, 1),
        "SDs": (10, 1),
        "SDs of rows 1 to 9": (9, 1),
    }


def test_the_scores_are_what_the_report_says():
    e = np.exp
    numbers = np.array([[e(0.0), e(1.0), e(2.0), e(3.0), e(4.0)]])
    half = (np.quantile(np.arange(5), 0.84) - np.quantile(np.arange(5), 0.16)) / 2
    squares = evidence.squared_logs(numbers)[0]
    np.testing.assert_allclose(squares, ((np.arange(5) - 2) / half) ** 2)
    p = np.minimum(1, 2 * np.array([1, 2, 3, 2, 1]) / 5)
    np.testing.assert_allclose(evidence.rank_scores(numbers)[0], -2 * np.log(p))
    ratios = np.array([[0.9, 1.2], [1.05, 1.0]])
    deviation, largest = (SCORES_OF_MEANS[name] for name in (MEAN_DEVIATION, "largest error"))
    np.testing.assert_allclose(deviation.of_tables(ratios), [-0.025, 0.1])
    np.testing.assert_allclose(largest.of_tables(ratios), [0.1, 0.2])
    logs = SCORES_OF_SDS["mean logarithm"].of_tables(np.exp(ratios))
    np.testing.assert_allclose(logs, ratios.mean(axis=0))


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
def test_p_by_rows_holds_its_level_where_rows_share_nothing_even_for_few_tables(score, few_draws):
    """Of 100 printed tables, each one more beside five of ours; ties of a largest error make it hold more."""
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


def test_the_committed_multiverse_is_made_of_the_committed_realisations(kept, multiverse):
    made = evidence.make_multiverse(kept)
    pd.testing.assert_frame_equal(made, multiverse, rtol=1e-5, check_dtype=False)


def test_rows_that_share_settings_or_start_are_tested_by_whole_tables(multiverse):
    tests = multiverse.dropna(subset="p")
    by_tables = (tests["settings"] == evidence.TOGETHER) | (tests["start"] == "per table")
    assert ((tests["by"] == "tables") == by_tables).all()
    choices = multiverse[["start", "settings"]].drop_duplicates()
    assert len(choices) == len(SETTINGS) + len(DRAWN_STARTS) + 1 + len(DRAWN)
    assert len(multiverse) == len(choices) * (5 + 4 + 4)
    assert (tests["p"] >= tests["least_p"] * 0.999).all()
    assert tests["false_alarms"].mean() < 0.06


def test_a_table_that_is_off_is_rejected_by_every_test(kept, few_draws):
    printed = evidence.printed_table()
    off = evidence.Tables(1.3 * printed.ratios, 20 * printed.sds)
    tests = evidence.make_multiverse(kept, off).dropna(subset="p")
    assert (tests.loc[tests["start"] == WHOLE, "p"] < 0.05).all()


# ------------------------------------------------------------------------------------------------- what is said


def set_p(multiverse, start, p, scores=(MEAN_DEVIATION,)):
    chosen = (multiverse["start"] == start) & multiverse["score"].isin(scores)
    return multiverse.assign(p=multiverse["p"].mask(chosen, p))


def decide_random_start(multiverse, criteria=None):
    measured = evidence.measure_random_start(multiverse, criteria)
    return decide_all(claims.write_all({"random_start": measured}), criteria)["random_start"]


def test_a_random_start_is_decided_by_all_its_readings_and_by_ours_of_the_whole_record(multiverse):
    likely = set_p(multiverse, "per row", 0.001)
    excluded = set_p(set_p(likely, "per fit", 0.001), "per table", 0.001)
    cases = [(set_p(excluded, WHOLE, 0.5), False), (set_p(excluded, WHOLE, 0.001), None)]
    allowed = set_p(excluded, "per table", 0.2)
    cases += [(set_p(allowed, WHOLE, 0.5), None), (set_p(allowed, WHOLE, 0.001), True)]
    for table, holds in cases:
        assert decide_random_start(table)[0] is holds
    strict = decide_random_start(set_p(allowed, WHOLE, 0.5), {"random_start": 0.3})
    assert strict[0] is False


def test_what_excludes_a_reading_is_named_with_the_likely_reading_first(multiverse):
    scores = [*SCORES_OF_MEANS, *SCORES_OF_SDS]
    table = set_p(multiverse, "per row", 0.5, scores)
    table = set_p(table, "per row", 0.001, ["largest error", "mean logarithm"])
    sds = (table["start"] == "per row") & (table["numbers"] == "SDs") & (table["score"] == "ranks")
    table = table.assign(p=table["p"].mask(sds, 0.001))
    table = set_p(table, "per fit", 0.001, scores)
    table = table.assign(least_p=table["least_p"].mask(table["start"] == "per table", 0.02))
    _, words = decide_random_start(set_p(table, "per table", 0.02, scores))
    likely, each_fit, once = words.partition("; whole record")[0].split("; ")
    assert likely.startswith(
        "mean deviation, the start drawn once a row, the likely reading p = 0.5,"
    )
    assert likely.endswith(
        "excluded at 1 % by the means' largest error, the SDs' ranks and mean logarithm"
    )
    assert each_fit.endswith("excluded at 1 % by all 7 scores")
    assert once.endswith("excluded at 1 % by none, because so few tables give no p below 0.01")
    assert words.endswith("Drawn under 2 of the 8 settings")
    assert (
        evidence.name_exclusions(set_p(table, WHOLE, 0.9, scores), WHOLE, 0.05)
        == "none of 7 scores"
    )


def test_rejections_are_counted_of_the_tests_that_could_reject(multiverse):
    table = set_p(multiverse, "per row", 0.5, SCORES_OF_MEANS)
    table = set_p(table, "per row", 0.01, ["squares"])
    counted = evidence.count_rejections(table, "per row", "means")
    assert counted == evidence.Rejections(tests=12, rejected=3, smallest=0.01, largest=0.5)
    together = (table["start"] == "per row") & (table["settings"] == evidence.TOGETHER)
    few = table.assign(least_p=table["least_p"].mask(together, 0.1))
    assert evidence.count_rejections(few, "per row", "means")[:2] == (8, 2)


def test_starts_are_compared_by_one_measure_under_the_settings_that_all_have(kept, monkeypatch):
    compared = evidence.compare_starts(kept)
    theoretical = dict(enumerate(published.column("Table 2", "theoretical"), 1))
    printed = evidence.printed_table()
    names = {each.name for each in DRAWN_STARTS}
    for start, row in compared.iterrows():
        same = [each for each in (*SETTINGS, *DRAWN_STARTS) if each.start == start]
        protocols = [each.protocol for each in same if each.name in names]
        ours = kept[kept["protocol"].isin(protocols) & (kept["row"] <= 10)]
        ratio = ours["mean_A_rps"] / ours["row"].map(theoretical)
        off = 100 * ratio.groupby([ours["protocol"], ours["realisation"]]).mean() - 100
        assert (row["settings"], row["tables"]) == (2, len(off))
        assert row["deviation_percent"] == pytest.approx(off.mean())
        ends = off.groupby(level=0).mean()
        assert row["smallest_percent"] == pytest.approx(ends.min())
        assert row["largest_percent"] == pytest.approx(ends.max())
        assert row["reaching"] == (off >= 100 * printed.ratios.mean() - 100).sum()
    higher = evidence.Tables(2 * printed.ratios, printed.sds / 100)
    monkeypatch.setattr(evidence, "printed_table", lambda: higher)
    moved = evidence.compare_starts(kept)
    assert moved["reaching"].tolist() == [0, 0, 0, 0]
    assert moved["means_inside"].tolist() == [0, 0, 0, 0]


def test_what_the_report_says_of_the_whole_record_is_counted(kept, multiverse):
    described = evidence.describe_multiverse(kept, multiverse)
    whole = described["whole"]
    of_row = kept[(kept["row"] == 10) & kept["protocol"].isin([each.protocol for each in SETTINGS])]
    assert (whole["tables"], whole["settings"]) == (len(of_row), len(SETTINGS))
    assert whole["row10_smallest_rps"] == of_row["sd_A_rps"].min()
    assert whole["row10_below"] == (of_row["sd_A_rps"] > 0.0194).sum()
    sds = evidence.count_rejections(multiverse, WHOLE, "SDs")
    assert whole["sds_rejected"] == sds.rejected / sds.tests
    assert described["rejections"][WHOLE]["SDs"] == f"{sds.rejected} of {sds.tests} tests"
    kept_p = multiverse.set_index(["start", "settings", "numbers", "score"])["p"]
    ranks = kept_p[WHOLE, evidence.TOGETHER, "SDs", "ranks"]
    assert described["p_of_sds"]["SDs"]["ranks"] == f"{ranks:.2g}"


@pytest.mark.parametrize(
    ("counted", "words"),
    [
        (evidence.Rejections(36, 0, 0.1, 0.9), "none of 36 tests"),
        (evidence.Rejections(9, 9, 0.0, 0.01), "all 9 tests"),
        (evidence.Rejections(9, 4, 0.0, 0.5), "4 of 9 tests"),
        (evidence.Rejections(0, 0, np.nan, np.nan), "too few tables to test"),
    ],
)
def test_rejections_are_said_as_they_were_counted(counted, words):
    assert evidence.write_rejections(counted) == words


def test_a_p_is_said_with_what_it_can_be_at_least():
    said = [evidence.write_p(0.437), evidence.write_p(0.0004), evidence.write_p(0.0031, 0.0031)]
    assert said == ["0.44", "below 0.001", "at most 0.0031"]


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
