"""The command line: answers, files, exit statuses, and one line where something is wrong."""

import json
import re
from unittest.mock import Mock

import pandas as pd
import pytest

from backlash import estimates
from backlash.answer import Estimate
from replication.files import ROOT
from tests.logs import command, file, noisy, write

SPEED = "--turn-period 0.4"
RATIOS = "--torque 3 --gear-ratio 100 --inertia-ratio 2 --gravity 30"
MASSES = (
    "--torque 3 --gear-ratio 100 --motor-inertia 1e-4 --load-mass 20 --load-arm 0.4 --load-inertia"
)


@pytest.fixture
def log(tmp_path):
    return write(noisy(), tmp_path / "A10.csv")


def test_what_is_given_of_the_load_reaches_the_fit_and_its_answer_is_json(log, examine, capsys):
    assert command("estimate", log, MASSES, "3 --json --from 1 --inertia-sd 0.2") == 0
    request = examine.call_args.args[1]
    assert (request.options.torque, request.options.start_s) == ("3", 1.0)
    assert request.load.inertia_ratio == pytest.approx(3.2)
    assert request.load.inertia_sd == 0.2
    assert request.load.note.endswith("3 is below m r^2 = 3.2 kg m^2: that was taken")
    [answer] = json.loads(capsys.readouterr().out)
    assert answer["joint"]["loss"] == [0.1, 0.02]
    assert answer["total_play_rad"] == 2e-3


def test_a_line_of_json_has_the_name_of_its_joint_and_its_quantities(log, examine, capsys):
    table = file(log.parent, f"file,joint\n{log.name},A4\n", "plant.csv")
    assert command("estimate --jsonl --jobs 1", SPEED, "--batch", table) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["joint_name"], answer["joint"]) == ("A4", {"loss": [0.1, 0.02]})


def test_an_answer_is_printed_and_its_fit_drawn(log, tmp_path, capsys):
    figure = tmp_path / "fit.png"
    assert command("estimate", log, SPEED, "--plot", figure) == 0
    assert "log the torque" in capsys.readouterr().out
    assert figure.stat().st_size > 10_000


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_table_is_written_where_a_link_points_and_again_until_something_is_added(
    ending, log, tmp_path, examine, capsys
):
    out, link = tmp_path / f"answers.{ending}", tmp_path / f"link.{ending}"
    link.symlink_to(out)
    read = getattr(pd, f"read_{ending}")
    for _ in range(2):  # which is no log the second time
        assert command("estimate", tmp_path, SPEED, "--out", link) == 0
    table = read(out)
    assert table["verdict"].tolist() == ["backlash"]
    assert link.is_symlink()
    assert not out.with_name(f"answers.{ending}.kept").exists()
    for added in (
        table.assign(remark="mine"),
        table.assign(verdict="see Anna"),
        table[["version"]],
        table[["verdict"]],
    ):
        getattr(added, f"to_{ending}")(out, index=False)
        assert command("estimate", log, SPEED, "--out", out) == 2
        assert "not what this command writes" in capsys.readouterr().err
        assert read(out).equals(added)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("", "the load's turn is not known"),
        ("--turn-period -1", "--turn-period -1.0: give a finite number above 0"),
        ("--turn-period 0.4 --speed a --position b", "give one of them"),
        ("--turn-period 0.4 --from nan", "give seconds, the end after the start"),
        ("--turn-period 0.4 --gravity 30", "give --torque and --inertia-ratio too"),
        (f"{RATIOS} --inertia-ratio 0", "above 0"),
        (f"{RATIOS} --gravity nan", "above 0"),
        (f"{RATIOS} --inertia-sd -0.1", "above 0"),
        (f"{RATIOS} --gravity-sd 10", "above 0"),
        ("--torque 3 --gear-ratio 9 --load-mass 1", "give --motor-inertia and --load-arm too"),
        (f"{MASSES} 4 --inertia-ratio 2", "by its ratios or by its masses"),
        (f"{MASSES} 1", "its mass at its arm alone has 3.2 kg m^2"),
        (f"{MASSES} 4 --gear-ratio 1", "give the load by --inertia-ratio and --gravity, not by"),
        ("--turn-period 0.4 --out log.txt", "its name must end in"),
        ("--turn-period 0.4 --jobs 0 --out answers.csv", "--jobs 0"),
        ("--turn-period 0.4 --batch missing.csv", "give logs, or --batch"),
        ("- --turn-period 0.4", "(the standard input) goes alone"),
        ("other.csv --turn-period 0.4 --plot fit.png", "--plot: 2 logs; it shows one"),
        ("--turn-period 0.4 --out no/answers.csv", "name a file in a folder that you may write"),
        ("--turn-period 0.4 --out A10.csv", "one of the inputs"),
        ("--turn-period 0.4 --out mine.csv", "holds no answers of a run before"),
        ("--turn-period 0.4 --out linked.csv", "holds no answers of a run before"),
    ],
)
def test_what_is_wrong_is_one_line_and_status_2_and_overwrites_nothing(
    log, options, words, capsys, monkeypatch
):
    monkeypatch.chdir(file(log.parent, "mine", "mine.csv.kept").parent)
    (log.parent / "linked.csv.kept").symlink_to("nowhere")
    before = log.read_bytes()
    assert command("estimate", log, options) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert log.read_bytes() == before


def test_of_many_logs_unusable_ones_are_counted_and_if_all_are_the_first_says_why(log, capsys):
    assert command("estimate", log, "missing.csv --jobs 1", SPEED) == 0
    assert "1 of 2 logs are not usable" in capsys.readouterr().err
    assert command("estimate missing.csv gone.csv --jobs 1", SPEED) == 2
    assert "none of 2 logs is usable; the first: missing.csv: No" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (ZeroDivisionError("7"), 1, "please report it: ZeroDivisionError: 7"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_a_defect_and_an_interruption_are_one_line(log, error, status, words, monkeypatch, capsys):
    monkeypatch.setattr(estimates, "examine", Mock(side_effect=error))
    assert command("estimate", log, SPEED) == status
    error_line = capsys.readouterr().err
    assert words in error_line
    assert error_line.count("\n") == 1


def test_help_and_readme_have_a_line_that_answers_on_the_example_as_the_readme_says(
    tmp_path, monkeypatch, capsys
):
    with pytest.raises(SystemExit):
        command("estimate --help")
    text = " ".join(capsys.readouterr().out.split())
    assert "--gear-ratio 1" in text
    assert "four turns or more in one direction" in text
    assert "moves to and fro through the position in which its load hangs" in text
    monkeypatch.chdir(tmp_path)
    line = re.search(r"backlash (example); backlash (estimate .*?) \.", text)
    assert [command(words) for words in line.groups()] == [0, 0]
    answer = capsys.readouterr().out
    readme = (ROOT / "README.md").read_text("utf-8")
    assert (
        f"$ backlash {line[2]}\n{answer.partition('  stiffness')[0].splitlines()[-1]}\n" in readme
    )


def test_an_answer_gives_half_of_the_play_and_the_whole_in_the_units_of_data_sheets():
    answer = Estimate("log", "backlash", None, "", 8.39e-4, (6.4e-4, 9.44e-4), arm_m=2.0)
    assert answer.summary == (
        "backlash 0.839 mrad, half of the play (95 %: 0.640 to 0.944); "
        "the whole play 1.68 mrad, 5.77 arcmin, 3.36 mm at 2 m"
    )
