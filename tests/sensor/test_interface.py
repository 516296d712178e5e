import doctest

import numpy as np
import pandas as pd
import pytest

import backlash
from tests.logs import noisy, write

KNOWN_RAD = np.linspace(4e-4, 16e-4, 7).tolist()


def test_the_examples_of_the_documentation_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(noisy(), tmp_path / "log.csv")
    logs = [write(noisy(delta), tmp_path / f"{delta}.csv") for delta in KNOWN_RAD]
    months = pd.date_range("2024-01-15", periods=7, freq="MS")
    many = pd.DataFrame({"file": logs, "date": months, "joint": "A1"})
    how = {"turn_period_s": 0.4, "method": "energy"}
    answers = backlash.estimate_many(many, **how).reset_index()
    answers = pd.concat([answers, answers.assign(joint="A2")])
    shown = {"pd": pd, "logs": logs, "files": logs[:2], "dates": months, "known_rad": KNOWN_RAD}
    shown |= {"t": noisy().t, "v": noisy().v, "answers": answers}
    said, find = [], doctest.DocTestFinder(recurse=False).find
    for name in ("read_log", "estimate", "calibrate", "trend", "estimate_many", "trend_many"):
        (example,) = find(getattr(backlash, name), name, globs=shown)
        doctest.DocTestRunner().run(example, out=said.append)
    assert not said, "".join(said)


def test_arrays_a_table_a_file_and_a_log_that_was_read_have_one_answer(tmp_path):
    path = write(noisy(), tmp_path / "log.csv")
    how = {"turn_period_s": 0.4, "unit": "rps"}
    frame = pd.read_csv(path)
    logs = [
        (frame,),
        (frame.set_index("time [s]"),),
        (frame[["speed [rps]"]].set_index(pd.to_timedelta(frame["time [s]"].array, unit="s")),),
        (path,),
        (str(path),),
        (frame["time [s]"], frame["speed [rps]"]),
        (frame.assign(**{"time [s]": pd.to_timedelta(frame["time [s]"], unit="s")}),),
    ]
    answers = [backlash.estimate(*log, method="energy", **how) for log in logs]
    answers.append(backlash.estimate(backlash.read_log(path, **how), method="energy"))
    assert len({answer.backlash_rad for answer in answers}) == 1
    named = [answer.file for answer in answers]
    assert named == ["log"] * 3 + [str(path)] * 2 + ["log"] * 2 + [str(path)]
    assert str(answers[0]).startswith("log: backlash 0.")


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"turn_period_s": None}, "load's turn is not known"),
        ({"turn_period_s": "0.4"}, "--turn-period '0.4': give"),
        ({"speed": 9}, "no column '9'"),
        ({"seed": np.random}, "whole numbers"),
        ({"method": "magic"}, "method 'magic'"),
        ({"log": [0, 1], "v": [1, 2, 3]}, r"shapes \(2,\) and \(3,\)"),
        ({"log": {"t": [0]}}, "one dict is no log: .* or a pandas table"),
        ({"torque": "2", "inertia_ratio": "2", "gravity_per_s2": 25}, "all numbers"),
        ({"log": "\x1b[2J"}, r"\?\[2J: no"),
    ],
)
def test_what_cannot_be_used_is_an_error_of_one_line(said, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(noisy(), tmp_path / "log.csv")
    with pytest.raises(backlash.Refusal, match=words) as caught:
        backlash.estimate(**({"log": "log.csv", "turn_period_s": 0.4} | said))
    assert "\n" not in str(caught.value)


def test_what_other_calls_cannot_use_is_an_error_too(tmp_path):
    log, how = write(noisy(), tmp_path / "log.csv"), {"turn_period_s": 0.4}
    with pytest.raises(backlash.Refusal, match=r"too short: 2\.4 load turns"):
        backlash.read_log(log, turn_period_s=2.0)
    with pytest.raises(backlash.Refusal, match="was read already"):
        backlash.estimate(backlash.read_log(log, **how), gear_ratio=40)
    with pytest.raises(backlash.Refusal, match="1 dates"):
        backlash.trend([log] * 3, ["2024-01-01"] * 3, method="energy", **how)
    with pytest.raises(backlash.Refusal, match="one dict of logs"):
        backlash.estimate_many({"file": [log]}, **how)
    with pytest.raises(backlash.Refusal, match="needs 6 or more"):
        backlash.calibrate([log], [1e-3], **how)


def test_a_log_that_cannot_be_used_is_left_out_of_a_trend_and_named(tmp_path):
    logs = [write(noisy(seed=k), tmp_path / f"axis_2024-0{k}-01.csv") for k in range(1, 6)]
    logs[2].write_text("", "utf-8")
    write(noisy(0.0), logs[3])
    found = backlash.trend(logs, turn_period_s=0.4, method="energy")
    assert len(found.points) == 3
    assert "2 of 5 logs are left out" in found.warnings
    assert any("2024-03-01.csv: the file is empty" in warning for warning in found.warnings)
    assert any("2024-04-01.csv: no backlash" in warning for warning in found.warnings)
