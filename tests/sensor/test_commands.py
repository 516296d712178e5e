import hashlib
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import backlash
from backlash import commands
from backlash.calibration import default_calibration
from replication.records import authors_file, level_delta_rad
from tests.logs import ANSWER_KEYS, command, file, noisy, silent, write

TURN = "--turn-period 0.4"


@pytest.fixture
def log(tmp_path):
    return write(noisy(), tmp_path / "log.csv")


@pytest.fixture
def run(capsys):
    """Run a command: its exit status, its output and what it said on the error stream."""

    def ran(*arguments):
        try:
            status = command(*arguments)
        except SystemExit as stopped:
            status = stopped.code
        return status, *capsys.readouterr()

    return ran


@pytest.fixture
def rows(run):
    """Estimate, and read the rows of JSON."""

    def estimated(*arguments):
        status, out, _ = run("estimate", *arguments, "--json")
        assert status == 0
        return json.loads(out)

    return estimated


@pytest.fixture
def refused(run, tmp_path):
    """Run a command that is refused in one line with exit status 2 and leaves the folder as it was; the line."""

    def line(*arguments):
        before = sorted(tmp_path.rglob("*"))
        status, out, err = run(*arguments)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert sorted(tmp_path.rglob("*")) == before
        return err

    return line


# ---------------------------------------------------------------------------------------------------------------
# estimate


def test_json_has_an_object_of_the_documented_keys_for_each_log_with_the_play_and_the_origin(
    log, tmp_path, run, rows
):
    write(noisy(0.0), tmp_path / "healthy.csv")
    how = f"{TURN} --method energy --jobs 1"
    found = rows(log, tmp_path / "healthy.csv", how)
    assert [list(row) for row in found] == [ANSWER_KEYS, ANSWER_KEYS]
    assert [row["verdict"] for row in found] == ["backlash", "no backlash"]
    row = found[0]
    assert row["total_play_rad"] == 2 * row["backlash_rad"]
    assert row["total_play_interval_rad"] == [2 * end for end in row["backlash_interval_rad"]]
    assert row["sha256"] == hashlib.sha256(log.read_bytes()).hexdigest()
    assert row["calibration"] == default_calibration("energy").provenance
    assert row["version"] == backlash.__version__
    lines = run("estimate", tmp_path, how, "--jsonl")[1].splitlines()
    assert sorted(map(json.loads, lines), key=found.index) == found


def test_every_option_of_a_log_reaches_its_reader(tmp_path, rows):
    record = noisy()
    counts = np.floor(np.cumsum(record.v) * 2e-3 * 2**16) % 2**16
    frame = pd.DataFrame({"a": record.t, "b": counts, "c": 60 * record.v})
    frame.to_csv(tmp_path / "log.csv", index=False)
    position = "--position b --unit counts --counts-per-turn 65536 --commanded-speed 100"
    for given in (position, "--speed c --unit rpm"):
        (row,) = rows(tmp_path / "log.csv", f"--method energy --gear-ratio 40 --time a {given}")
        assert row["amplitude_rps"] == pytest.approx(0.58, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_a_plot_is_written_and_the_same_twice(ending, log, tmp_path, run):
    contents = []
    for name in ("a", "b"):
        path = tmp_path / f"{name}.{ending}"
        assert run("estimate", log, f"{TURN} --plot", path)[0] == 0
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]
    assert not list(tmp_path.glob(".*"))


def test_no_terminal_or_spreadsheet_obeys_the_name_of_a_file(log, tmp_path, run, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = [f"{first}2024-03-0{k}.csv" for k, first in enumerate("=\x1b\udcff", 1)]
    for name in names:
        (tmp_path / name).write_bytes(log.read_bytes())
    how = f"{TURN} --method energy"
    assert run("estimate", *names, how, "--out out.csv")[0] == 0
    assert pd.read_csv("out.csv")["file"].str[:2].tolist() == ["'=", "\x1b2", "?2"]
    out = run("trend", *names, how)[1]
    assert "growth" in out
    assert out.replace("\n", "").isprintable()


def test_programs_get_a_row_for_each_log_though_none_is_usable(tmp_path, run):
    logs = tmp_path / "none.csv", tmp_path / "loop.csv"
    logs[1].symlink_to(logs[1])
    status, out, _ = run("estimate", *logs, f"{TURN} --json")
    assert (status, [row["file"] for row in json.loads(out)]) == (2, [str(log) for log in logs])


@pytest.mark.parametrize(
    ("fail_on", "status"),
    [("backlash", 3), ("cannot-tell, backlash > 0.8mrad", 3), ("backlash>1.0mrad", 0)],
)
def test_a_script_is_told_by_the_exit_status_of_a_log_that_it_must_not_pass(
    fail_on, status, log, run
):
    ended, out, _ = run(
        "estimate", log, f"{TURN} --method energy --fail-on", repr(fail_on), "--json"
    )
    assert ended == status
    assert json.loads(out)[0]["verdict"] == "backlash"


@pytest.mark.parametrize(
    ("table", "why"),
    [
        ("file,gear_ratio\nlog.csv,\n", "batch.csv, log.csv: the load's turn is not known"),
        ("file,turn_period_s,shoe_size\nlog.csv,0.4,42\n", "column 'shoe_size'"),
        ("file,gear_ratio\n", "no rows"),
    ],
    ids=["no turn", "an unknown column", "no rows"],
)
def test_a_table_of_logs_that_cannot_be_used_is_refused(table, why, log, tmp_path, refused):
    assert why in refused("estimate --batch", file(tmp_path, table, "batch.csv"))


def test_a_defect_is_one_line_that_says_where(log, run, monkeypatch):
    monkeypatch.setattr(commands, "examine", lambda *_: 1 / 0)
    status, out, err = run("estimate", log, TURN)
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert "please report it: ZeroDivisionError: division by zero (test_commands.py, line" in err


# ---------------------------------------------------------------------------------------------------------------
# Refusals


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("estimate LOG", "--turn-period (in s) or --gear-ratio"),
        ("estimate LOG --turn-period 0.4 --unit rpm", "says rps, --unit says rpm"),
        ("estimate LOG --turn-period 0.4 --plot FOLDER/plot.gif", "must end in"),
        ("estimate LOG --turn-period 0.4 --plot FOLDER/missing/plot.png", "cannot be written"),
        ("estimate LOG FOLDER/log2.csv --turn-period 0.4 --plot FOLDER/plot.png", "it shows one"),
        (
            "estimate FOLDER/empty.csv FOLDER/empty2.csv --turn-period 0.4 --out FOLDER/table.csv",
            "none of 2 logs is usable",
        ),
        ("estimate FOLDER/void --turn-period 0.4", "no logs in this folder"),
        ("estimate FOLDER/missing.csv --turn-period 0.4", "no such file"),
        ("estimate LOG --turn-period 0.4 --calibration LOG", "not a calibration file"),
        ("calibrate LOG --turn-period 0.4 --out FOLDER/c.json", "columns log and backlash_rad"),
        ("trend LOG --turn-period 0.4", "no date in its name"),
        ("trend LOG --turn-period 0.4 --dates FOLDER/dates.csv --limit 0.5", "at most 0.1 [rad]"),
        ("estimate", "give logs, or --batch"),
        ("estimate --batch LOG --turn-period 0.4", "no table with the columns file"),
        ("estimate LOG - --turn-period 0.4", "goes alone"),
        (
            "estimate LOG --turn-period 0.4 --fail-on 'no-backlash>1mrad'",
            "--fail-on 'no-backlash>1mrad': give",
        ),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_line_and_nothing_is_written(
    arguments, expected, log, tmp_path, refused
):
    for name in ("log2.csv", "empty.csv", "empty2.csv"):
        (tmp_path / name).touch()
    (tmp_path / "void").mkdir()
    file(tmp_path, "file,date\nlog.csv,2024-03-17\n", "dates.csv")
    assert expected in refused(arguments.replace("LOG", str(log)).replace("FOLDER", str(tmp_path)))


# ---------------------------------------------------------------------------------------------------------------
# calibrate


@pytest.fixture
def known(tmp_path):
    """A table of eight logs of known backlash."""
    levels = np.linspace(4e-4, 20e-4, 8)
    logs = [
        write(noisy(delta, seed=50 + k), tmp_path / f"known{k}.csv").name
        for k, delta in enumerate(levels)
    ]
    path = tmp_path / "known.csv"
    pd.DataFrame({"log": logs, "backlash_rad": levels}).to_csv(path, index=False)
    return path


@pytest.mark.parametrize("method", ["energy", pytest.param("waveform", marks=pytest.mark.slow)])
def test_a_calibration_goes_round_from_logs_to_a_file_to_an_estimate(
    method, known, tmp_path, run, rows
):
    made = tmp_path / "joint.json"
    status, out, _ = run("calibrate", known, f"{TURN} --method", method, "--out", made)
    assert status == 0
    assert "0.400 to 2.000 mrad" in out
    content = json.loads(made.read_text("utf-8"))
    assert (content["method"], content["range_rad"]) == (method, [4e-4, 20e-4])
    assert "8 logs, SHA-256" in content["provenance"]
    log = write(noisy(11e-4, seed=3), tmp_path / "new.csv")
    (row,) = rows(log, f"{TURN} --calibration", made)
    assert row["method"] == method
    assert row["backlash_rad"] == pytest.approx(11e-4, abs=1e-4)
    assert not any("paper's joint" in warning for warning in row["warnings"])
    worn = write(noisy(30e-4, seed=3), tmp_path / "worn.csv")
    _, out, _ = run("estimate", worn, f"{TURN} --calibration", made)
    assert "cannot tell: extrapolated calibration" in out


def test_a_calibration_from_a_log_that_is_no_use_names_it(known, tmp_path, refused):
    short = replace(noisy(), t=noisy().t[:300], v=noisy().v[:300])
    write(short, tmp_path / "known3.csv")
    line = refused("calibrate", known, f"{TURN} --out", tmp_path / "c.json")
    assert "known3.csv: no use for a calibration: too short" in line


# ---------------------------------------------------------------------------------------------------------------
# trend and the rest


def write_months(folder, slower=1.0):
    """Dated logs of a joint that wears."""
    for month in range(1, 8):
        log = noisy(4e-4 + 1.5e-4 * month, seed=month)
        write(replace(log, t=slower * log.t), folder / f"axis4_2024-{month:02d}-15.csv")


def test_dated_logs_become_a_trend_with_a_date_and_a_plot(tmp_path, run):
    write_months(tmp_path)
    options = f"{TURN} --method energy --limit 0.0018"
    status, out, _ = run("trend", tmp_path, options, "--plot", tmp_path / "trend.png", "--json")
    found = json.loads(out)
    assert status == 0
    assert len(found["points"]) == 7
    first, last = found["crossing_interval"]
    assert first < found["crossing_date"] < last
    assert "2024-09-15" < found["crossing_date"] < "2024-11-15"  # 0.0018 rad after 9.3 months
    assert (tmp_path / "trend.png").exists()
    assert "crossed on" in run("trend", tmp_path, options)[1]


def test_where_no_backlash_can_be_told_the_amplitudes_growth_in_percent_is_an_alarm(tmp_path, run):
    write_months(tmp_path, 1.5)
    options = "--turn-period 0.6 --method energy --limit 0.0018"
    status, out, err = run("trend", tmp_path, options, "--json")
    found = json.loads(out)
    assert (status, err) == (0, "")
    assert (found["is_relative"], found["alarm"], found["limit_rad"]) == (True, True, None)
    assert found["points"][0]["relative_index_percent"] == 100
    assert found["points"][-1]["relative_index_percent"] > 150
    assert "growth_rad_per_day" not in found
    text = run("trend", tmp_path, options)[1]
    assert "% of the first a year" in text
    assert "alarm: it grows" in text
    assert "not the backlash" in text


@pytest.mark.slow
@pytest.mark.parametrize("level", [4, 7, 10, 11])
def test_a_record_without_noise_is_answered_with_the_models_own_error_in_its_interval(
    authors_data, rows, level
):
    (row,) = rows(authors_file(f"Speeddata{level}.xlsx"), TURN)
    low, high = row["backlash_interval_rad"]
    assert (row["verdict"], row["method"]) == ("backlash", "self")
    assert low < level_delta_rad(level) < high
    assert high - low > 0.06 * row["backlash_rad"]


def test_an_output_never_overwrites_a_file_that_is_not_its_own(log, tmp_path, refused):
    before = log.read_bytes()
    line = refused("estimate", log, f"{TURN} --out", log)
    assert "that file is not of this command; name another, or remove it" in line
    own = write(silent(), tmp_path / "a.json")
    assert "not of this command" in refused("calibrate", log, f"{TURN} --out", own)
    assert log.read_bytes() == before


@pytest.mark.slow
def test_a_figure_of_each_log_that_has_a_fit_goes_into_a_folder(log, tmp_path, run):
    (tmp_path / "empty.csv").touch()
    status, _, _ = run(
        "estimate", tmp_path, f"{TURN} --method energy --plots", tmp_path / "figures"
    )
    assert status == 0
    assert [path.name for path in (tmp_path / "figures").iterdir()] == ["00002_log.png"]


def test_without_stamps_the_rate_is_enough(tmp_path, rows):
    log = file(tmp_path, "speed\n" + "\n".join(map(str, noisy().v)))
    (row,) = rows(log, TURN, "--method energy --rate 500")
    assert (row["verdict"], row["samples"]) == ("backlash", 2401)
    assert "taken as even, 500 Hz, as said" in row["warnings"]


def test_a_log_of_the_joints_side_is_recognised_by_its_turns(tmp_path, run):
    slow = replace(noisy(), v=noisy().v / 40)
    how = "--gear-ratio 40"
    _, out, _ = run("estimate", write(slow, tmp_path / "log.csv"), how)
    assert "0.3 load turns of 16 s" in out
    assert "is this the joint's side? then --gear-ratio 1" in out
