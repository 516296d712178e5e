"""The workbook's command line: one line about what is wrong, and exit statuses."""

import os
import subprocess
import sys

import pytest

import workbook
from workbook import __main__ as command_line
from workbook import checkout, running
from workbook.__main__ import main as run_command

FIRST = workbook.ROOT / "notebooks" / "05_signature_figure6.py"


def test_a_command_without_its_data_says_so_in_one_line_and_exits_with_2(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    assert run_command(["data"]) == 2
    said = capsys.readouterr().err.strip()
    assert "BACKLASH_DATA" in said
    assert "\n" not in said


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["no-such"], "invalid choice"),
        (["run", "--watch", "x"], "--watch"),
        (["run", "missing.py"], "missing.py"),
    ],
)
def test_wrong_arguments_are_refused_in_one_line(given, said, capsys):
    try:
        status = run_command(given)
    except SystemExit as ended:
        status = ended.code
    line = capsys.readouterr().err
    assert status == 2
    assert said in line
    assert line.count("\n") == 1


def test_a_full_disk_is_no_defect():
    with open("/dev/full", "w") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "workbook", "check"],
            env=os.environ | {"PYTHONPATH": str(workbook.ROOT)},
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert ended.returncode == 1
    assert "the output cannot be written" in ended.stderr
    assert ended.stderr.count("\n") == 1


@pytest.mark.slow
def test_a_quick_run_never_overwrites_the_full_results(tmp_path, monkeypatch):
    monkeypatch.setitem(checkout.APART, tmp_path / "quick", checkout.APART[checkout.QUICK])
    for owner in (checkout, command_line):
        monkeypatch.setattr(owner, "QUICK", tmp_path / "quick")
    folders = [workbook.ROOT / name for name in ("results", "figures", "notebooks")]

    def full():
        files = (path for folder in folders for path in folder.rglob("*.*") if path.is_file())
        # Another test's, perhaps.
        return {path: path.read_bytes() for path in files if path.name != "run.json"}

    before = full()
    notebook = str(workbook.ROOT / "notebooks" / "02_dead_zone_figure9.py")
    for command in (["run", notebook], ["report"]):
        assert run_command([*command, "--quick"]) == 0
    assert full() == before
    written = {path.name for path in (tmp_path / "quick").rglob("*")}
    assert {"figure09_dead_zone.svg", "verdicts.csv", "report.md"} <= written


def test_a_failed_notebook_makes_the_command_fail(monkeypatch):
    ending = running.Ending("x", "failed", 1.0)
    monkeypatch.setattr(running, "run_notebooks", lambda *_, **__: [ending])
    monkeypatch.setattr(running, "note_run", lambda _: None)
    assert run_command(["run", str(FIRST)]) == 1
