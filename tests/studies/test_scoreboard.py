import numpy as np
import pandas as pd
import pytest

from backlash.studies import scoreboard
from backlash.studies.__main__ import main
from replication import workbook
from replication.datasets import Recording


def test_simulated_logs_are_the_same_every_time_and_do_not_tell_their_backlash():
    first, second = scoreboard.simulated_logs(True), scoreboard.simulated_logs(True)
    assert len(first) == scoreboard.SIMULATED_LOGS
    for one, again in zip(first, second, strict=True):
        assert one.delta_rad == again.delta_rad
        assert (one.recording.v == again.recording.v).all()
        assert f"{one.delta_rad:g}" not in one.recording.source
        assert 3e-4 <= one.delta_rad <= 21e-4


def test_every_method_takes_a_record_and_gives_a_plausible_backlash():
    record = scoreboard.simulated_logs(False)[0]
    quick = {
        name: method
        for name, method in scoreboard.SCORED_METHODS.items()
        if "CMA" not in name and "annealing" not in name
    }
    for name, method in quick.items():
        scores = scoreboard.score_logs(name, method, [record])
        assert abs(scores["error_rad"][0]) < 5e-4, name


def test_the_summary_has_the_promised_columns_and_knows_a_perfect_method():
    logs = scoreboard.simulated_logs(False)[:3]
    truth = {id(log.recording): log.delta_rad for log in logs}
    table = scoreboard.summary(scoreboard.score_logs("truth", lambda record: truth[id(record)], logs))
    assert table.columns.tolist() == [
        "method", "logs", "mean_abs_error_rad", "max_abs_error_rad", "rmse_rad", "seconds_per_log",
    ]  # fmt: skip
    assert table["logs"][0] == 3
    assert table["max_abs_error_rad"][0] == 0


def constant(recording: Recording) -> float:
    return 1e-3


def not_a_number(recording: Recording) -> float:
    return float("nan")


def test_the_score_command_scores_a_function_by_name(authors_data, capsys):
    assert main(["score", "tests.studies.test_scoreboard:constant"]) == 0
    out = capsys.readouterr().out
    assert all(kind in out for kind in ("authors:", "simulated:", "drifted:", "all:"))


def test_without_the_authors_logs_the_score_says_so_and_goes_on(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    assert main(["score", "tests.studies.test_scoreboard:constant"]) == 0
    shown = capsys.readouterr()
    assert "authors:" not in shown.out
    assert shown.err.startswith("without the authors' logs:")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("no colon", "module:function"),
        ("nowhere_at_all:method", "No module named"),
        ("tests.studies.test_scoreboard:nothing", "has no attribute"),
        ("tests.studies.test_scoreboard:pytest", "not a function"),
        ("tests.studies.test_scoreboard:not_a_number", "is no backlash"),
        ("json:dumps", "TypeError"),
    ],
)
def test_an_unusable_method_is_one_line_and_exit_2(name, words, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    assert main(["score", name]) == 2
    shown = capsys.readouterr()
    assert words in shown.err
    assert shown.err.count("\n") == 1


def test_the_committed_table_has_every_method_on_every_log():
    table = pd.read_csv(workbook.ROOT / "results" / "scoreboard.csv")
    assert table.columns.tolist() == scoreboard.COLUMNS
    assert table["method"].tolist() == list(scoreboard.SCORED_METHODS)
    assert (table["logs"] == len(scoreboard.AUTHORS_LOGS) + 2 * scoreboard.SIMULATED_LOGS).all()
    scores = pd.read_csv(workbook.ROOT / "results" / "scoreboard_logs.csv")
    again = scoreboard.summary(scores.assign(seconds=1.0)).drop(columns="seconds_per_log")
    pd.testing.assert_frame_equal(again, table.drop(columns="seconds_per_log"), rtol=1e-4)


def test_plain_baselines_are_worse_than_the_waveform_in_the_committed_table():
    error = pd.read_csv(workbook.ROOT / "results" / "scoreboard.csv").set_index("method")["mean_abs_error_rad"]
    assert error["waveform"] < min(error["peak to peak"], error["band-passed RMS"])
    assert np.isfinite(error).all()
