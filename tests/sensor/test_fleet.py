import os
from dataclasses import replace
from pathlib import Path

import pytest

from backlash import fleet
from backlash.examine import examine
from backlash.settings import settings_for
from tests.logs import TURN, file, noisy, write

SETTINGS = settings_for(TURN, method="amplitude")


def answers(paths, settings=SETTINGS, jobs=1, kept=None):
    """Answers in the order of their logs."""
    found = dict(fleet.run_fleet(paths, [settings] * len(paths), jobs, kept))
    return [found[number] for number in sorted(found)]


@pytest.fixture
def folder(tmp_path):
    """Five logs, one of them empty, one with text in its numbers."""
    logs = tmp_path / "logs"
    (logs / "deeper").mkdir(parents=True)
    for name, delta in (("log0.csv", 5e-4), ("log1.csv", 9e-4), ("deeper/healthy.csv", 0.0)):
        write(noisy(delta), logs / name)
    file(logs, "time,speed\n0,1\n1,x\n2,3\n", "text.csv")
    for name in ("empty.csv", "notes.md", ".hidden.csv"):
        (logs / name).touch()
    return logs


class Deadly(type(Path())):
    """A path that ends any process that asks for it but the one whose number is in its name."""

    def __str__(self):
        path = super().__str__()
        if "deadly" in path and f"deadly{os.getpid()}" not in path:
            os._exit(1)
        return path


def test_a_folder_stands_for_all_logs_below_it_each_once(folder):
    (folder / "circle").symlink_to("circle")
    found = fleet.find_logs([folder, folder / "log1.csv", folder / "missing.csv"])
    assert [path.name for path in found] == [
        "healthy.csv",
        "empty.csv",
        "log0.csv",
        "log1.csv",
        "text.csv",
        "missing.csv",
    ]


def test_one_bad_log_or_a_defect_never_stops_the_rest_and_its_row_says_why(folder, monkeypatch):
    def broken(path, settings):
        if path.name == "log0.csv":
            raise ZeroDivisionError("division\nby zero")
        return examine(path, settings)

    monkeypatch.setattr(fleet, "examine", broken)
    paths = fleet.find_logs([folder])
    rows = answers(paths)
    assert [row.file for row in rows] == [str(path) for path in paths]
    assert [rows[0].verdict, rows[3].verdict] == ["no backlash", "backlash"]
    empty = f"unusable log: {paths[1]}: the file is empty; export the log again"
    assert rows[1].warnings == (empty,)
    assert rows[2].warnings[0].endswith("log0.csv: ZeroDivisionError: division by zero")
    assert rows[4].warnings[0].startswith("unusable log: ")
    assert {rows[k].verdict for k in (1, 2, 4)} == {"cannot tell"}


@pytest.mark.slow
def test_several_processes_give_the_same_rows_as_one_and_a_log_on_which_one_dies_costs_its_row_only(
    folder,
):
    deadly = f"deadly{os.getpid()}.csv"
    write(noisy(), folder / deadly)
    paths = [Deadly(folder / name) for name in ("log0.csv", deadly, "empty.csv")]
    alone, together = (answers(paths, jobs=jobs) for jobs in (1, 2))
    assert alone[1].verdict == "backlash"
    assert "the process that read it died" in together[1].warnings[0]
    assert (alone[0], alone[2]) == (together[0], together[2])


# ---------------------------------------------------------------------------------------------------------------
# Resuming


def counting(monkeypatch, stop_after=None):
    """Names of the logs that are estimated; the run is interrupted after some of them."""
    done = []

    def counted(path, settings):
        if stop_after is not None and len(done) == stop_after:
            raise KeyboardInterrupt
        done.append(path.name)
        return examine(path, settings)

    monkeypatch.setattr(fleet, "examine", counted)
    return done


def test_an_interrupted_run_goes_on_where_it_was(folder, tmp_path, monkeypatch):
    paths, kept = fleet.find_logs([folder]), tmp_path / "kept"
    whole = answers(paths)
    first = counting(monkeypatch, stop_after=3)
    with pytest.raises(KeyboardInterrupt):
        answers(paths, kept=kept)
    second = counting(monkeypatch)
    assert answers(paths, kept=kept) == whole
    assert sorted(first + second) == sorted(path.name for path in paths)


def test_a_changed_log_or_other_settings_are_not_taken_from_what_was_kept(
    folder, tmp_path, monkeypatch
):
    paths, kept = fleet.find_logs([folder]), tmp_path / "kept"
    answers(paths, kept=kept)
    write(noisy(15e-4), folder / "log0.csv")
    done = counting(monkeypatch)
    answers(paths, kept=kept)
    assert done == ["log0.csv"]
    answers(paths, replace(SETTINGS, seed=2), kept=kept)
    assert len(done) == 1 + len(paths)
