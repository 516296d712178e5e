import os
import shutil
import subprocess
import sys

import pytest

import workbook
from workbook import checkout, judging
from workbook.main import main


@pytest.fixture
def without_data(tmp_path, monkeypatch):
    """An empty folder in place of the authors' data."""
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))


@pytest.mark.parametrize("command", ["data", "identify-joint"])
def test_a_command_without_its_data_says_so_in_one_line_and_exits_with_2(command, without_data, capsys):
    assert main([command]) == 2
    said = capsys.readouterr().err.strip()
    assert "BACKLASH_DATA" in said
    assert "\n" not in said


def test_a_notebook_without_its_data_is_not_run_and_leaves_no_stamp(without_data, tmp_path, capsys):
    stamp = tmp_path / "stamp"
    source = workbook.ROOT / "notebooks" / "01_signature_figure6.py"
    executed = source.with_suffix(".ipynb")
    before = executed.read_bytes()
    assert main(["run", "--stamp", str(stamp), str(source)]) == 0
    assert not stamp.exists()
    assert executed.read_bytes() == before
    assert "01_signature_figure6: not run" in capsys.readouterr().err


def test_a_notebook_that_is_not_there_is_refused_by_name(capsys, tmp_path):
    assert main(["run", str(tmp_path / "missing.py")]) == 2
    assert "missing.py" in capsys.readouterr().err


@pytest.mark.slow
def test_check_prints_every_printed_number_and_fails_only_if_asked_to_be_strict(capsys):
    table = judging.verdicts(workbook.ROOT / "results")
    assert main(["check"]) == 0
    printed = capsys.readouterr().out
    assert all(number in printed for number in table["printed"])
    assert main(["check", "--strict"]) == int((table["verdict"] == "differs").any())


@pytest.mark.slow
def test_sensitivity_without_its_data_says_so_in_one_line_and_exits_with_2(tmp_path):
    environment = os.environ | {"BACKLASH_DATA": str(tmp_path), "PYTHONPATH": str(workbook.ROOT)}
    command = [sys.executable, "-m", "tests.tools.sensitivity"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 2
    assert "BACKLASH_DATA" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("command", ["run", "check", "report"])
def test_outside_a_checkout_the_workbooks_commands_say_so_in_one_line_and_exit_with_2(command, tmp_path):
    shutil.copytree(
        workbook.ROOT / "replication", tmp_path / "replication", ignore=shutil.ignore_patterns("__pycache__")
    )
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-m", "workbook", command], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert "is not the project's folder" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_folder_with_another_projects_file_is_no_checkout(tmp_path):
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "other"\n', encoding="utf-8")
    with pytest.raises(checkout.NoCheckout):
        checkout.require_checkout(tmp_path)
    checkout.require_checkout(workbook.ROOT)


@pytest.mark.slow
def test_a_quick_run_never_overwrites_the_full_results(tmp_path, monkeypatch):
    for owner in ("workbook", "report.commands", "files"):
        monkeypatch.setattr(f"replication.{owner}.QUICK", tmp_path / "quick")
    folders = [workbook.ROOT / name for name in ("results", "figures", "notebooks")]

    def full():
        files = {path for folder in folders for path in folder.rglob("*") if path.is_file()}
        files -= {workbook.ROOT / "results" / "run.json"}  # of the last run, which may be another test's
        return {path: path.read_bytes() for path in files if workbook.ROOT / "results" / "quick" not in path.parents}

    before = full()
    source = workbook.ROOT / "notebooks" / "02_dead_zone_figure9.py"
    assert main(["run", "--quick", str(source)]) == 0
    for command in ("collect", "report"):
        assert main([command, "--quick"]) == 0
    assert full() == before
    written = {path.name for path in (tmp_path / "quick").rglob("*")}
    assert {"figure09_dead_zone.svg", "dead_zone_facts.csv", "verdicts.csv", "report.html"} <= written
    page = (tmp_path / "quick" / "results" / "report.html").read_text(encoding="utf-8")
    assert "This is a quick run with few repeats." in page
    assert "A quick run" not in (workbook.ROOT / "results" / "report.html").read_text(encoding="utf-8")
