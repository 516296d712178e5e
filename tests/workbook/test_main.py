"""The workbook's command line: one line about what is wrong, and exit statuses."""

import os
import re
import subprocess
import sys

import pytest

import workbook
from workbook import __main__ as command_line
from workbook import checkout, running
from workbook.__main__ import main as run_command

FIRST = workbook.ROOT / "notebooks" / "01_signature_figure6.py"


def started(*command, **options):
    environment = os.environ | {"PYTHONPATH": str(workbook.ROOT)} | options.pop("environment", {})
    return subprocess.run(
        [sys.executable, "-m", *command], env=environment, text=True, check=False, **options
    )


def test_a_command_without_its_data_says_so_in_one_line_and_exits_with_2(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    assert run_command(["data"]) == 2
    said = capsys.readouterr().err.strip()
    assert "BACKLASH_DATA" in said
    assert "\n" not in said


def test_a_notebook_that_is_not_there_is_refused_by_name(capsys, tmp_path):
    assert run_command(["run", str(tmp_path / "missing.py")]) == 2
    assert "missing.py" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "said"), [(["no-such"], "invalid choice"), (["run", "--watch", "x"], "--watch")]
)
def test_wrong_arguments_are_refused_in_one_line(given, said, capsys):
    with pytest.raises(SystemExit) as ended:
        run_command(given)
    assert ended.value.code == 2
    line = capsys.readouterr().err
    assert said in line
    assert line.count("\n") == 1


def test_every_command_is_listed_with_a_sentence(capsys):
    with pytest.raises(SystemExit):
        run_command(["--help"])
    listed = re.findall(r"^    (\w+) +[A-Z].*", capsys.readouterr().out, re.MULTILINE)
    assert {"run", "check", "show"} <= set(listed)


def test_a_reader_who_has_seen_enough_and_a_full_disk_are_no_defects():
    with open("/dev/full", "w") as full:
        ended = started("workbook", "show", "Table 1", stdout=full, stderr=subprocess.PIPE)
    assert ended.returncode == 1
    assert "the output cannot be written" in ended.stderr
    assert ended.stderr.count("\n") == 1
    piped = subprocess.Popen(
        [sys.executable, "-m", "workbook", "show", "Table 1"],
        env=os.environ | {"PYTHONPATH": str(workbook.ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    piped.stdout.close()
    assert piped.stderr.read() == b""
    assert piped.wait() == 1


@pytest.mark.slow
def test_sensitivity_without_its_data_says_so_in_one_line_and_exits_with_2(tmp_path):
    ended = started(
        "tests.tools.sensitivity", environment={"BACKLASH_DATA": str(tmp_path)}, capture_output=True
    )
    assert ended.returncode == 2
    assert "BACKLASH_DATA" in ended.stderr
    assert ended.stderr.count("\n") == 1


@pytest.mark.slow
def test_a_quick_run_never_overwrites_the_full_results(tmp_path, monkeypatch):
    said = checkout.APART[checkout.QUICK]
    monkeypatch.setitem(checkout.APART, tmp_path / "quick", said)
    for owner in (checkout, command_line):
        monkeypatch.setattr(owner, "QUICK", tmp_path / "quick")
    folders = [workbook.ROOT / name for name in ("results", "figures", "notebooks")]

    def full():
        files = (path for folder in folders for path in folder.rglob("*.*") if path.is_file())
        # Another test's, perhaps.
        return {path: path.read_bytes() for path in files if path.name != "run.json"}

    before = full()
    notebook = str(workbook.ROOT / "notebooks" / "02_dead_zone_figure9.py")
    for command in (["run", notebook], ["collect"], ["report"]):
        assert run_command([*command, "--quick"]) == 0
    assert full() == before
    written = {path.name for path in (tmp_path / "quick").rglob("*")}
    assert {"figure09_dead_zone.svg", "verdicts.csv", "report.html"} <= written
    page = (tmp_path / "quick" / "results" / "report.html").read_text("utf-8")
    assert said in page


def test_a_failed_notebook_makes_the_command_fail(monkeypatch):
    ending = running.Ending("x", "failed", 1.0)
    monkeypatch.setattr(running, "run_notebooks", lambda *_, **__: [ending])
    monkeypatch.setattr(running, "note_run", lambda _: None)
    assert run_command(["run", str(FIRST)]) == 1
