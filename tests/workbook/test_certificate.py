"""A certificate says what ran here with this code, and names each file that is not as it is committed."""

import shutil
import subprocess
from pathlib import Path
from unittest.mock import Mock

import pandas as pd
import pytest

from replication.files import DataUnavailable, UserError, write_files, write_kept
from workbook import certificate, judging, stamps

NAMES = ("01_one", "02_two")
VERDICTS = pd.DataFrame(
    {"grade": judging.GRADES, "notebook": ["01_one", "02_two", "01_one", "02_two", "02_two"]}
)


def git(folder, *words):
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    subprocess.run(["git", *who, *words], cwd=folder, check=True)


@pytest.fixture(params=["project", "."], ids=["alone", "inside another repository"])
def clone(request, project, monkeypatch, tmp_path, leave_run):
    """A clone of two notebooks that ran here and a report, committed, with a kept table."""
    folder = project(**dict.fromkeys(NAMES, "# %%\n"))
    (folder / "README.md").write_text("A readme.\n")
    (folder / ".gitignore").write_text(".make\n__pycache__\n")
    (folder / "tools" / "kept.py").write_text("print('x,y')\nprint('1,a')\n")
    write_kept(folder / "results" / "table.csv", pd.DataFrame({"x": [2, 1], "y": ["b", "a"]}))
    for name in NAMES:
        made = {f"figures/{name}.svg": b"a figure", f"notebooks/{name}.ipynb": b"a notebook"}
        leave_run(name, {"cells": [{"id": name, "source": "recomputed", "numbers": 1.0}]}, made)
    report = {folder / "results" / "report.md": b"a report\n"}
    write_files(report)
    git(tmp_path / request.param, "init", "-q")
    git(folder, "add", "-A")
    git(folder, "commit", "-q", "-m", "made")
    monkeypatch.setattr(certificate, "make_report", lambda: report)
    monkeypatch.setattr(judging, "verdicts", lambda: VERDICTS)
    return folder


def certified(full=False):
    about = certificate.certify(full)
    return about, about["differences"], certificate.write_certificate(about)


def test_where_nothing_ran_nothing_is_certified(clone):
    shutil.rmtree(clone / ".make")
    with pytest.raises(UserError, match="no notebook was run here"):
        certificate.certify()


def test_in_the_clone_of_another_project_nothing_is_certified(clone):
    git(clone, "rm", "-r", "-q", "--cached", ".")
    with pytest.raises(UserError, match="git has nothing of it"):
        certificate.certify()


def test_where_one_notebook_ran_the_others_and_their_numbers_stand_apart(clone):
    stamps.stamp_file(NAMES[1]).unlink()
    _, differences, page = certified()
    assert differences == ["02_two: not run here"]
    assert "| notebooks run here with this code | 1 of 2, 12 s in sum, " in page
    assert "| made here and the same | 4 of 4 files that were made here |" in page
    assert "not made here | table.csv; of what is made, 4 files were not |" in page
    here = "1 agrees, 0 agrees weakly, 1 consistent, 0 differs, 0 not tested |"
    assert f"| printed numbers, by notebooks run here | {here}" in page
    others = "0 agrees, 1 agrees weakly, 0 consistent, 1 differs, 1 not tested |"
    assert f"| printed numbers, by committed outcomes | {others}" in page


def test_where_all_ran_to_the_same_bytes_there_is_no_difference(clone):
    about, differences, page = certified()
    assert differences == []
    assert "| changed since | nothing |" in page
    assert len(about["summary"]["commit"]) == 40
    assert "| notebooks run here with this code | 2 of 2, 24 s in sum, 1" in page
    assert "| made here and the same | 7 of 7 files" in page
    assert "| printed numbers, by committed outcomes | none |" in page
    assert "- no difference\n" in page


def test_after_a_code_change_that_is_committed_nothing_ran_with_this_code(clone):
    (clone / "tools" / "rules.py").write_text("population = 30\n")
    git(clone, "add", "-A")
    git(clone, "commit", "-q", "-m", "fewer")
    about, differences, page = certified()
    assert differences[0].startswith("no number is judged: 01_one: made by other code")
    assert differences[1:] == [f"{name}: {stamps.MADE_BY_OTHER}" for name in NAMES]
    assert "| notebooks run here with this code | 0 of 2," in page
    assert about["numbers"] == {}


CHANGES = [
    "figures/01_one.svg",
    "results/table.csv",
    "results/report.md",
    "notebooks/01_one.ipynb",
    "tools/more.py",
]


@pytest.mark.parametrize("name", CHANGES)
def test_a_byte_that_changes_is_named(clone, name):
    with (clone / name).open("a") as file:
        file.write(" ")
    about, differences, _ = certified()
    assert about["summary"]["changed since"] == name
    is_result = not name.startswith("tools")
    assert f"{name}: {'not as committed' if is_result else 'changed since'}" in differences


def test_a_notebook_that_lacks_its_data_is_said_and_is_no_difference(clone):
    stamps.write_stamp(NAMES[1], lacks="needs logs")
    _, differences, page = certified()
    assert differences == []
    assert "- 02_two: not run: needs logs\n" in page


@pytest.mark.parametrize(
    ("code", "says"),
    [
        (
            "import sys\nprint('1,a' if sys.argv[1] == 'table' else '')\n",
            "a row made again is the same",
        ),
        ("print('x,y')\nprint('1,b')\n", "a row made again is another"),
        ("raise SystemExit('no logs')", "a row is not made again: no logs"),
    ],
)
def test_a_row_of_a_kept_table_is_made_again_where_that_is_asked_for(clone, code, says):
    (clone / "tools" / "kept.py").write_text(code)
    about, differences, page = certified(full=True)
    assert f"- results/table.csv: {says}\n" in page
    assert about["kept"] == {"results/table.csv": says}
    assert (f"results/table.csv: {says}" in differences) == says.endswith("another")


def test_runs_at_the_same_time_are_not_counted_twice_in_the_wall_time():
    runs = [{"seconds": 10, "ended": 100 + k} for k in (0, 5, 40)]
    assert certificate.sum_up_seconds(runs) == "30 s in sum, 25 s of wall time"


def test_data_that_could_not_be_had_are_one_line_and_a_changed_file_is_named(monkeypatch):
    # Of a file that is not there the SHA-256 is "".
    hooks = {"checksums": lambda: {"a.xlsx": "00", "b.xlsx": ""}, "fetch": Path}
    monkeypatch.setattr(certificate, "find_hook", lambda name, default=None: hooks[name])
    assert certificate.check_data() == {"a.xlsx": "a.xlsx is not the registered one", "b.xlsx": ""}
    hooks["fetch"] = Mock(side_effect=DataUnavailable("no network"))
    assert certificate.check_data() == dict.fromkeys(["a.xlsx", "b.xlsx"], "no network")
