"""Many logs: what tables say of each, workers that die, and runs that go on."""

import errno
import json
import os
import re
from pathlib import Path
from unittest.mock import Mock

import pandas as pd
import pytest

import backlash
from backlash import batch, estimates
from backlash.answer import Estimate
from backlash.batch import find_logs, options_of, read_batch
from backlash.cli import estimate_logs
from tests.logs import command, file, noisy, write

HOW = {"turn_period_s": 0.4}
FULL = Mock(side_effect=OSError(errno.ENOSPC, "No space left on device"))
CSV = (
    "file,joint,date,turn_period_s,torque,trust_period,remark\n"
    "a.csv,007,2024-03-17,0.4,3,no,left arm\n,=1+1,,?,,,\nc.csv,,2024-13-45,,,,\nd.csv,,,0.4,,maybe,\n"
    "e.csv,,17.03.2024,,,,\nf.csv,,March 17 2024,,,,\n"
)
LONGER = ",,,,,,\na.csv,A,,0,4,3,no,left arm\n"  # 0.4 with a decimal comma
BAD_CELLS = (
    "turn_period_s is '?', no number",
    "date is '2024-13-45', no date like",
    "trust_period is 'maybe', neither yes nor no",
    "date is '17.03.2024', no date like 2024-03-17",
    "date is 'March 17 2024', no date like 2024-03-17",
)


@pytest.fixture
def plant(tmp_path) -> Path:
    """A table with four dates of two joints."""
    rows = [f"A{k}{m}.csv,A{k},2024-0{m}-15\n" for m in range(1, 5) for k in (1, 2)]
    return file(tmp_path, "file,joint,date\n" + "".join(rows), "plant.csv")


def test_answers_are_a_table_by_joint_and_date(plant, examine):
    answers = backlash.estimate_many(plant, **HOW, jobs=1)
    assert answers.index.names == ["joint", "date"]
    first = answers.iloc[0]
    assert first["backlash_low_rad"] == pytest.approx(1.09e-3)
    assert first["total_play_high_rad"] == pytest.approx(2.22e-3)
    assert (first["loss"], first["loss_sd"], first["notes"]) == (0.1, 0.02, "one; two")


@pytest.mark.parametrize("delimiter", [",", ";", "parquet"])
def test_a_table_is_text_and_a_bad_cell_refuses_its_own_row(delimiter, tmp_path):
    path = tmp_path / "plant"
    whys = BAD_CELLS
    if delimiter == "parquet":
        pd.read_csv(file(tmp_path, CSV), dtype=str).to_parquet(path)
    else:
        path.write_text((CSV + LONGER).replace(",", delimiter), "utf-8")
        whys += ("'left arm' stands beyond the header's columns",)
    read = read_batch(path, {"inertia_ratio": 2.0, "gravity_per_s2": 30.0})
    assert read["joint"].tolist()[:2] == ["007", "=1+1"]
    assert read["date"].notna().sum() == 1
    assert read["file"].tolist()[:2] == [tmp_path / "a.csv", tmp_path]
    said = {"torque": "3", "turn_period_s": 0.4, "trust_period": False}
    [first, *others] = read.to_dict("records")
    assert options_of(first) == said
    for row, why in zip(others, whys, strict=True):
        with pytest.raises(backlash.Refusal, match=re.escape(why)):
            options_of(row)


def test_of_a_file_that_a_table_names_its_kind_is_told_and_not_its_content(tmp_path):
    secret = file(tmp_path, "root:$6$hash:19000:0:99999\nyou:$6$secret's:19000:0:99999\n", "shadow")
    write(noisy(), tmp_path / "log.csv")
    table = file(tmp_path, "file,speed\nshadow,\nlog.csv,vel\n", "plant.csv")
    [of_secret, of_log] = backlash.estimate_many(table, **HOW, jobs=1)["explanation"]
    assert "in its first 65536 characters; its last line is '...'; export it again" in of_secret
    assert "no column 'vel'; there are '...', '...'" in of_log
    [own] = backlash.estimate_many([str(secret)], **HOW, jobs=1)["explanation"]
    assert "secret's" in own


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a,b\n1,2\n", "no column 'file'; there are 'a', 'b'"),
        ("file\n", "no rows"),
        ("file,file\na.csv,b.csv\n", "two of its columns have one name"),
        ("file,gear_ration\na.csv,1\n", "column 'gear_ration' is not read; is it 'gear_ratio'"),
        (None, "one int of logs; give a list of them"),
    ],
)
def test_what_lists_no_logs_is_refused(text, why, tmp_path):
    with pytest.raises(backlash.Refusal, match=why):
        backlash.estimate_many(file(tmp_path, text) if text else 3, **HOW)


def test_an_interrupted_run_goes_on_from_its_journal(plant, tmp_path, examine):
    logs = read_batch(plant, HOW)
    journal = tmp_path / "answers.csv.kept"
    each = batch.run_batch(logs, HOW, 1, journal)
    first = dict(next(each) for _ in range(3))
    each.close()
    torn = journal.read_text("utf-8")
    journal.write_text(torn + torn.splitlines()[0][:40], "utf-8")
    examine.reset_mock()
    answers = dict(batch.run_batch(logs, HOW, 1, journal))
    assert sorted(answers) == list(range(8))
    # The third answer is handed over before it is written.
    assert 5 <= examine.call_count <= 6
    assert json.dumps(answers[0].to_dict()) == json.dumps(first[0].to_dict())


def test_on_a_full_disk_no_table_is_written_and_the_same_command_goes_on(
    plant, tmp_path, examine, monkeypatch, capfd
):
    out = tmp_path / "answers.csv"
    words = f"estimate --turn-period 0.4 --jobs 1 --batch {plant} --out {out}"
    with monkeypatch.context() as disk:
        disk.setattr(estimate_logs, "write_csv", FULL)
        assert command(words) == 1
    assert capfd.readouterr().err.splitlines() == [
        "the answer cannot be written (No space left on device)"
    ]
    assert not out.exists()
    examine.reset_mock()
    assert command(words) == 0
    assert not examine.called
    assert len(pd.read_csv(out)) == 8


def test_a_full_disk_is_no_defect_of_the_log_that_is_read(monkeypatch):
    monkeypatch.setattr(estimates, "examine", FULL)
    with pytest.raises(OSError, match="No space left"):
        dict(batch.run_batch(read_batch(["a.csv", "b.csv"], HOW), HOW, 1))


class Killer:
    """A log that ends the process that takes it."""

    def __reduce__(self):
        return os._exit, (9,)


@pytest.mark.slow
def test_two_workers_say_what_one_says_and_one_that_dies_costs_its_own_log_only(tmp_path):
    names = ["a.csv", "b.csv"]
    alone = dict(batch.run_batch(read_batch(names, HOW), HOW, 1))
    logs = read_batch([*names, Killer()], HOW)
    answers = dict(batch.run_batch(logs, HOW, 2))
    assert {number: answers[number] for number in alone} == alone
    assert sorted(answers) == [0, 1, 2]
    assert "the process that read it died" in answers[2].explanation


def test_a_defect_of_one_log_stops_no_other(plant, examine):
    examine.side_effect = ZeroDivisionError("of one")
    answers = backlash.estimate_many(plant, **HOW, jobs=1)
    assert len(answers) == 8
    assert answers["explanation"].str.contains("ZeroDivisionError: of one").all()


def test_folders_are_searched_and_an_empty_one_is_refused(tmp_path):
    write(noisy(), tmp_path / "b.csv")
    file(tmp_path, "x", ".hidden.csv")
    assert find_logs([tmp_path, tmp_path / "b.csv"]) == [tmp_path / "b.csv"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(backlash.Refusal, match="no logs in this folder"):
        find_logs([tmp_path / "empty"])


RAW = ["=cmd|' /C calc'!A0", "+1", "-2+3", "@sum(1)", "\t=1", "a,=1", "b\n=1"]


def test_no_text_of_a_table_that_is_written_begins_a_formula():
    """Names of logs, joints, columns and what refusals quote of them; JSON has them as they are."""
    answers = [Estimate(text, explanation=text, columns=text, notes=(text,)) for text in RAW]
    assert [answer.to_dict()["explanation"] for answer in answers] == RAW
    table = batch.as_table(answers, pd.DataFrame({"joint": RAW}))
    for text in table[["joint", "file", "explanation", "columns", "notes"]].to_numpy().ravel():
        cells = re.split(r"[,;\t\r\n]", text)
        assert not any(cell.lstrip().startswith(tuple("=+@-")) for cell in cells), text
