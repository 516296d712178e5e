"""The command line as a process of its own: interrupted, in a pipe, and the first time on a machine."""

import os
import shutil
import signal
import subprocess
import sys
import time
from io import BytesIO, TextIOWrapper

import pytest

from backlash import fleet
from backlash.reading.columns import LogFormat
from backlash.settings import settings_for
from tests.logs import command, noisy, text, write
from workbook import ROOT

PIPES = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}


def started(*arguments):
    """A process of the command line that leads a group, as it does at a terminal."""
    command = [sys.executable, "-m", "backlash", *map(str, arguments)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, cwd=ROOT, env=environment, start_new_session=True, **PIPES)


@pytest.fixture
def logs(tmp_path):
    """Sixty logs of one joint, for half a minute of fits."""
    (tmp_path / "logs").mkdir()
    first = write(noisy(), tmp_path / "logs" / "log0.csv")
    for k in range(1, 60):
        shutil.copy(first, first.with_name(f"log{k}.csv"))
    return tmp_path / "logs"


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_an_interrupt_ends_a_fleet_in_one_line_and_spoils_no_row(jobs, logs, tmp_path):
    kept = tmp_path / "table.csv.kept"
    process = started(
        "estimate", logs, "--turn-period", "0.4", "--jobs", jobs, "--out", tmp_path / "table.csv"
    )
    while process.poll() is None and not (kept.exists() and "verdict" in kept.read_text()):
        time.sleep(0.05)
    time.sleep(0.2)  # it computes now, whatever it does
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert (process.returncode, out) == (130, "")
    assert err == f"interrupted; the same command goes on from {kept}\n"
    assert not (tmp_path / "table.csv").exists()
    done = fleet.read_kept(kept).values()
    assert 1 <= len(done) < 60
    assert {answer.verdict for answer in done} == {"backlash"}


@pytest.mark.slow
def test_a_parent_that_is_killed_leaves_no_process_behind(logs, tmp_path):
    out = tmp_path / "table.csv"
    process = started("estimate", logs, "--turn-period", "0.4", "--jobs", "2", "--out", out)
    while process.poll() is None and not out.with_name("table.csv.kept").exists():
        time.sleep(0.05)
    process.kill()
    # The pipes close when the last process ends that has them.
    process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL


def test_an_interrupted_run_from_python_writes_no_log_down_as_unusable(tmp_path, monkeypatch):
    def interrupted(log, settings):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise SystemError("returned a result with an exception set") from error

    monkeypatch.setattr(fleet, "examine", interrupted)
    with pytest.raises(KeyboardInterrupt):
        list(fleet.run_fleet(["log.csv"], [settings_for(LogFormat(turn_period_s=0.4))], 1))


@pytest.mark.parametrize("option", [pytest.param("--help", marks=pytest.mark.slow), "--json"])
def test_a_reader_that_has_seen_enough_makes_no_noise(option, tmp_path):
    log = write(noisy(), tmp_path / "log.csv")
    process = started("estimate", log, "--gear-ratio", "40", option)
    process.stdout.close()
    assert process.wait(timeout=300) in (0, 1)
    assert process.stderr.read() == ""


def test_the_standard_input_is_a_log_and_an_empty_one_is_refused(monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", TextIOWrapper(BytesIO(text().encode())))
    assert command("estimate - --turn-period 0.4 --method energy") == 0
    assert capsys.readouterr().out.startswith("-: backlash 0.")
    monkeypatch.setattr(sys, "stdin", TextIOWrapper(BytesIO(b"")))
    assert command("estimate - --turn-period 0.4") == 2
    assert capsys.readouterr() == ("", "-: the file is empty; export the log again\n")


@pytest.mark.parametrize("closing", [">/dev/full", pytest.param(">&-", marks=pytest.mark.slow)])
def test_an_answer_that_cannot_be_written_is_one_line(closing, tmp_path):
    log = write(noisy(), tmp_path / "log.csv")
    command = (
        f"{sys.executable} -m backlash estimate {log} --turn-period 0.4 --method energy {closing}"
    )
    ended = subprocess.run(["/bin/sh", "-c", command], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr.count("\n")) == (1, 1)
    assert "the answer cannot be written (" in ended.stderr
