"""The command line: answers, files, exit statuses, and one line where something is wrong."""

import json
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest

from backlash import commands
from studies.benches import draw_turns
from tests.logs import command, noisy, write

SPEED = "--turn-period 0.4 --method waveform"


@pytest.fixture
def log(tmp_path):
    return write(noisy(), tmp_path / "log_2024-03-17.csv")


@pytest.fixture
def torque_log(tmp_path):
    made = draw_turns(np.random.default_rng((31, 0)), 9e-4, 0.15, 0.1)
    path = tmp_path / "torque.csv"
    frame = pd.DataFrame(
        {"time [s]": made.t, "motor speed [rps]": made.v, "torque [Nm]": made.torque}
    )
    frame.to_csv(path, index=False)
    options = f"--gear-ratio {made.gear_ratio} --inertia-ratio {made.inertia_ratio} --gravity {made.gravity_per_s2}"
    return path, f"--torque 'torque [Nm]' {options}"


def test_a_torque_log_is_answered_as_json_with_the_joint_s_quantities_and_a_figure(
    torque_log, tmp_path, capsys
):
    path, options = torque_log
    figure = tmp_path / "fit.png"
    assert command("estimate", path, options, "--json --plot", figure) == 0
    [answer] = json.loads(capsys.readouterr().out)
    assert (answer["verdict"], answer["method"]) == ("backlash", "torque")
    assert answer["chi_squared"] < 1.5
    assert {"stiffness_per_s2", "loss", "friction_share", "gravity_per_s2"} <= set(answer["joint"])
    assert "trace" not in answer
    assert figure.stat().st_size > 10_000


def test_an_answer_without_torque_and_calibration_says_what_to_do(log, capsys):
    assert command("estimate", log, "--turn-period 0.4") == 0
    assert "log the torque, or calibrate" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "met"),
    [
        ("backlash", 3),
        ("backlash>0.5mrad", 3),
        ("backlash>1.5mrad", 0),
        ("cannot-tell,no-backlash", 0),
    ],
)
def test_an_exit_status_tells_a_plant_s_program(log, words, met, capsys):
    assert command("estimate", log, SPEED, "--fail-on", f"'{words}'") == met


def test_a_table_is_written_and_an_answer_table_is_not_taken_for_a_log(log, tmp_path, capsys):
    out = tmp_path / "answers.csv"
    for _ in range(2):
        assert command("estimate", tmp_path, SPEED, "--out", out) == 0
    assert pd.read_csv(out)["verdict"].tolist() == ["backlash"]
    assert not out.with_name("answers.csv.kept").exists()


def test_a_calibration_is_made_and_used(tmp_path, capsys):
    known = [4e-4, 6e-4, 8e-4, 1e-3, 1.2e-3, 1.4e-3, 1.6e-3]
    logs = [
        write(noisy(delta, seed=k), tmp_path / f"{k}.csv").name for k, delta in enumerate(known)
    ]
    pd.DataFrame({"log": logs, "backlash_rad": known}).to_csv(tmp_path / "known.csv", index=False)
    own = tmp_path / "own.json"
    assert command("calibrate", tmp_path / "known.csv", "--out", own, "--turn-period 0.4") == 0
    assert "stiffness and drive" in capsys.readouterr().out
    assert (
        command("estimate", tmp_path / "3.csv", "--calibration", own, "--turn-period 0.4 --jsonl")
        == 0
    )
    answer = json.loads(capsys.readouterr().out)
    low, high = answer["backlash_interval_rad"]
    assert low < 1e-3 < high


def test_a_trend_of_amplitudes_needs_no_calibration(tmp_path, capsys):
    for month, delta in enumerate((6e-4, 9e-4, 1.2e-3, 1.5e-3), 1):
        write(noisy(delta, seed=month), tmp_path / f"axis_2024-0{month}-01.csv")
    figure = tmp_path / "trend.svg"
    assert command("trend", tmp_path, "--turn-period 0.4 --relative --json --plot", figure) == 0
    grown = json.loads(capsys.readouterr().out)
    assert grown["is_relative"]
    assert grown["alarm"]
    assert figure.exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("", "the load's turn is not known"),
        ("--turn-period 0.4 --gravity 30", "give --torque and --inertia-ratio too"),
        ("--turn-period 0.4 --out log.txt", "its name must end in"),
        ("--turn-period 0.4 --jobs 0 --out answers.csv", "--jobs 0"),
        ("--turn-period 0.4 --fail-on much", "--fail-on 'much'"),
        ("--turn-period 0.4 --calibration missing.json", "missing.json"),
    ],
)
def test_what_is_wrong_is_one_line_and_status_2(log, options, words, capsys, monkeypatch):
    monkeypatch.chdir(log.parent)
    assert command("estimate", log, options) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_an_input_is_never_overwritten(log, capsys):
    before = log.read_bytes()
    assert command("estimate", log, SPEED, "--out", log) == 2
    assert "one of the inputs" in capsys.readouterr().err
    assert log.read_bytes() == before
    notes = log.with_name("notes.csv")
    notes.write_text("mine")
    assert command("estimate", log, SPEED, "--out", notes) == 2
    assert "not of this command" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (ZeroDivisionError("7"), 1, "please report it: ZeroDivisionError: 7"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_a_defect_and_an_interruption_are_one_line(log, error, status, words, monkeypatch, capsys):
    monkeypatch.setattr(commands.estimates, "examine", Mock(side_effect=error))
    assert command("estimate", log, SPEED) == status
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1


def test_help_says_which_movement_and_which_side(capsys):
    with pytest.raises(SystemExit):
        command("estimate --help")
    text = " ".join(capsys.readouterr().out.split())
    assert "--gear-ratio 1" in text
    with pytest.raises(SystemExit):
        command("--help")
    assert "must turn round" in " ".join(capsys.readouterr().out.split())
