"""Many logs in one call: tables, workers, journals and trends."""

import json
import os
from pathlib import Path
from unittest.mock import Mock

import pandas as pd
import pytest

import backlash
from backlash import batch
from backlash.estimates import Estimate
from tests.logs import noisy, table, write

HOW = {"turn_period_s": 0.4, "method": "waveform"}


@pytest.fixture
def plant(tmp_path) -> Path:
    """A table with four dates of two joints; A2 is worn faster."""
    rows = []
    for month in range(1, 5):
        for joint, growth in (("A1", 1e-4), ("A2", 3e-4)):
            log = write(noisy(4e-4 + month * growth, seed=month), tmp_path / f"{joint}{month}.csv")
            rows.append((log.name, joint, f"2024-0{month}-15"))
    path = tmp_path / "plant.csv"
    pd.DataFrame(rows, columns=["file", "joint", "date"]).to_csv(path, index=False)
    return path


def test_answers_become_a_trend_for_each_joint(plant):
    answers = backlash.estimate_many(plant, **HOW)
    assert answers.index.names == ["joint", "date"]
    assert (answers["verdict"] == "backlash").all()
    trends = backlash.trend_many(answers, limit_rad=1.5e-3)
    assert list(trends) == ["A1", "A2"]
    assert trends["A2"].line[1] > 2 * trends["A1"].line[1]
    few = backlash.trend_many(answers.iloc[:4])
    assert str(few["A1"]) == "2 dates with an estimate; a trend needs 3 or more"


def test_a_table_is_text_and_a_bad_cell_refuses_its_own_row(plant):
    rows = pd.read_csv(plant)[:3].assign(
        turn_period_s=["0.4", "?", "0.4"], trust_period=["no", "", "maybe"]
    )
    rows.to_csv(plant, index=False)
    answers = backlash.estimate_many(plant, method="waveform")
    assert (answers["verdict"] == "backlash").tolist() == [True, False, False]
    assert "turn_period_s is '?', no number" in answers["explanation"].iloc[1]
    assert "neither yes nor no" in answers["explanation"].iloc[2]


def test_a_column_that_means_nothing_is_refused(plant):
    pd.read_csv(plant).assign(moment_x="x").to_csv(plant, index=False)
    with pytest.raises(backlash.Refusal, match="column 'moment_x'"):
        backlash.estimate_many(plant, **HOW)


def test_an_interrupted_run_goes_on_from_its_journal(plant, tmp_path, monkeypatch):
    logs = batch.read_batch(plant, HOW)
    journal = tmp_path / "answers.csv.kept"
    each = batch.run_batch(logs, 1, journal)
    first = dict(next(each) for _ in range(3))
    each.close()
    torn = journal.read_text("utf-8")
    journal.write_text(torn + torn.splitlines()[0][:40], "utf-8")
    examine = Mock(side_effect=batch.examine)
    monkeypatch.setattr(batch, "examine", examine)
    answers = dict(batch.run_batch(logs, 1, journal))
    assert sorted(answers) == list(range(8))
    # The third answer is handed over before it is written.
    assert 5 <= examine.call_count <= 6
    assert answers[0] == first[0]


class Killer:
    """A log that ends the process that takes it."""

    def __reduce__(self):
        return os._exit, (9,)


@pytest.mark.slow
def test_a_worker_that_dies_costs_its_own_log_only(plant):
    logs = batch.read_batch(plant, HOW)
    logs = logs._replace(logs=[*logs.logs[:3], Killer(), *logs.logs[4:]])
    answers = dict(batch.run_batch(logs, 2))
    assert sorted(answers) == list(range(8))
    assert [number for number in answers if batch.is_unusable(answers[number])] == [3]


def test_two_workers_say_what_one_says(plant):
    one, two = (backlash.estimate_many(plant, jobs=jobs, **HOW) for jobs in (1, 2))
    pd.testing.assert_frame_equal(one, two)


def test_a_defect_of_one_log_stops_no_other(monkeypatch):
    monkeypatch.setattr(batch, "examine", Mock(side_effect=ZeroDivisionError("of one")))
    answer = batch.examine_or_refuse("a.csv", None)
    assert batch.is_unusable(answer)
    assert "ZeroDivisionError: of one" in answer.explanation


def test_intervals_and_quantities_have_two_columns_each():
    answer = Estimate(
        "log",
        "backlash",
        backlash_rad=1e-3,
        backlash_interval_rad=(9e-4, 1.1e-3),
        joint={"loss": (0.1, 0.02)},
    )
    row = batch.as_table([answer]).iloc[0]
    assert (row["backlash_low_rad"], row["total_play_high_rad"]) == (9e-4, 2.2e-3)
    assert (row["loss"], row["loss_sd"]) == (0.1, 0.02)


def test_folders_are_searched_and_an_empty_one_is_refused(tmp_path):
    write(noisy(), tmp_path / "b.csv")
    (tmp_path / ".hidden.csv").write_text("x")
    assert batch.find_logs([tmp_path, tmp_path / "b.csv"]) == [tmp_path / "b.csv"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(backlash.Refusal, match="no logs in this folder"):
        batch.find_logs([tmp_path / "empty"])


def test_a_table_of_logs_travels_as_one_of_frames():
    answers = backlash.estimate_many([table(noisy()), table(noisy(1.5e-3))], **HOW)
    assert answers["backlash_rad"].is_monotonic_increasing
    assert json.dumps(answers["notes"].tolist())
