"""Which columns are read, in which units: the motor's measured ones, by name; what may be several things is asked."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from backlash.reading.columns import LogOptions
from backlash.reading.prepare import open_log
from tests.logs import TURN, T, V, file, opened, refusal, text

PER_TURN = {"rps": 1.0, "rpm": 60.0, "rad/s": 2 * np.pi, "deg/s": 360.0}
SPELLINGS = {
    "rps": ["speed_rps", "speed [rev/s]", "speed (s^-1)", "speed [Hz]"],
    "rpm": [
        *("Drehzahl [U/min]", "speed 1/min", "motorSpeedRPM", "speed [min⁻¹]", "vitesse [tr/min]"),
        *("speed.rpm", "speed_rpm_1", "speed [rpm] (2)", "Drehzahl [1/min] für Achse 5 °"),
    ],
    "rad/s": ["motor_vel_rad_per_s", "speed_radps", "speed [rad·s⁻¹]", "motorSpeedRadPerSec"],
    "deg/s": ["speed_deg_s", "speed [°/s]"],
}
ASKED = [
    *("speed", "velocity[0]", "speed %", "speed rpm/1000", "speed [rpm] (x10)", "speed [m/s]"),
    *("speed (filtered)", "speed in 0.01 rpm"),
    *("speed_kHz", "speed [kHz]", "speed_krpm", "speed_kRPM"),
]
# The columns beside the time, and which of them is read; none where the user is asked.
CHOICES = [
    (["speed [rps]", "motor speed [rpm]"], "motor speed [rpm]"),
    (["position [rev]", "motor encoder [rev]"], "motor encoder [rev]"),
    (["joint velocity [rps]", "speed [rps]"], "speed [rps]"),
    (["flange speed [rps]", "speed [rps]"], "speed [rps]"),
    (["speed [rps]", "position [rev]"], "speed [rps]"),
    (["target speed [rps]", "speed [rps]"], "speed [rps]"),
    (["speed_cmd_rps", "motor speed [rps]"], "motor speed [rps]"),
    (["speed [rps]", "velocity [rps]"], None),
    (["dq[0]", "dq[1]"], None),
    *(
        ([f"{word} speed [rps]", "current"], None)
        for word in ("target", "cmd", "set", "ref", "desired", "soll", "delta")
    ),
]


def frame(names) -> pd.DataFrame:
    """Columns of the speed, each a percent slower than the one before, beside the time."""
    columns = {
        name: 2e-3 * np.cumsum(V) if "rev" in name else (60 if "rpm" in name else 1) * V * 0.99**k
        for k, name in enumerate(names)
    }
    return pd.DataFrame({"time": T, **columns})


@pytest.mark.parametrize(
    ("unit", "name"), [(u, name) for u, names in SPELLINGS.items() for name in names]
)
def test_a_column_is_read_in_the_unit_of_its_name_and_both_are_in_the_answer(unit, name):
    log = opened(PER_TURN[unit] * V, name=name)
    np.testing.assert_allclose(log.recording.v, V)
    assert str(log.columns) == f"time 'time' [s], speed {name!r} [{unit}], the motor's side"


@pytest.mark.parametrize("name", ASKED)
def test_a_speed_without_a_known_unit_is_asked_for(name):
    assert "is not known; give --unit (a speed's: rps, rpm" in refusal(frame([name]))
    log = opened(60 * V, replace(TURN, unit="rpm"), name=name)
    np.testing.assert_allclose(log.recording.v, V)


@pytest.mark.parametrize(("names", "chosen"), CHOICES)
def test_the_motors_measured_column_is_read_and_two_candidates_are_asked_about(names, chosen):
    if chosen is None:
        assert "give --speed" in refusal(frame(names))
    else:
        assert repr(chosen) in str(open_log(frame(names), TURN).columns)


@pytest.mark.parametrize(
    ("name", "form", "is_load_side"),
    [
        ("speed [rps]", LogOptions(gear_ratio=40.0), False),
        ("speed [rps]", LogOptions(gear_ratio=1.0, commanded_speed_rps=2.5), True),
        ("joint speed [rps]", LogOptions(gear_ratio=40.0, speed="2"), True),
    ],
)
def test_a_log_says_of_which_side_of_the_gear_it_is(name, form, is_load_side):
    log = opened(V / (40.0 if form.gear_ratio == 1 else 1.0), form, name=name)
    assert log.columns.is_load_side == is_load_side
    assert ("the joint's side" in str(log.columns)) == is_load_side


def test_numbers_of_columns_are_the_files_whatever_these_hold(tmp_path):
    header = "time,comment,state,speed [rps],,moment,speed [rps]"
    path = file(tmp_path, text(header, "{t:.4f},,on,{v:.5f},,{rpm:.3f},7"))
    log = open_log(path, replace(TURN, speed="4", torque="6"))
    np.testing.assert_allclose(60 * log.recording.v, log.torque, atol=1e-3)
    assert "speed 'speed [rps] (4)' [rps], torque 'moment'" in str(log.columns)
    assert "'5' is empty in all 2,401 rows" in refusal(path, replace(TURN, speed="5", unit="rps"))


NAMES = ["motor speed [rpm]", "motor speed [rad/s]", "current [A]"]


@pytest.mark.parametrize(
    ("names", "given", "why"),
    [
        (["speed [rps]"], {"speed": "x"}, "no column 'x'; there are 'time', 'speed [rps]'"),
        (["speed [rps]"], {"speed": "9"}, "no column '9'"),
        (["speed [rps]"], {"speed": "1"}, "signal 'time' and torque '' cannot be one column"),
        (["speed [rps]"], {"unit": "rpm"}, "says rps, --unit says rpm; leave --unit out"),
        (["speed [counts/s]"], {}, "give --counts-per-turn"),
        (NAMES, {"speed": "motor speed"}, "no column 'motor speed'"),
        (["joint speed [rps]"], {"gear_ratio": 40.0}, "is the joint's side of the gear by its"),
        (["speed [rps]", "timestamp"], {}, "which column is the time: 'time', 'timestamp'? give"),
        (["speed [rps]", "moment", "t2 [s]"], {"torque": "moment", "time": "1"}, "stamps of its"),
        (["speed [rps]", "t2 [s]", "moment"], {"torque": "moment", "time": "1"}, "stamps of its"),
    ],
)
def test_columns_that_cannot_be_are_refused(names, given, why):
    assert why in refusal(frame(names), replace(TURN, **given))


def test_a_column_is_given_with_or_without_its_unit():
    log = open_log(frame(NAMES), replace(TURN, speed="Motor speed [rpm]", torque="current"))
    assert "speed 'motor speed [rpm]' [rpm], torque 'current [A]'" in str(log.columns)


@pytest.mark.parametrize("name", ["header.stamp", "time"])
def test_the_time_of_the_sample_goes_before_that_of_its_receipt(name):
    late = frame(["speed [rps]"]).assign(recv_time=np.round(T, 1))
    assert open_log(late.rename(columns={"time": name}), TURN).columns.time == name


def test_counts_per_turn_imply_counts_where_no_unit_is_named():
    form = replace(TURN, counts_per_turn=4096.0)
    for name, factor in (("speed", 4096.0), ("speed [rpm]", 60.0)):
        v = opened(factor * V, form, name=name).recording.v
        np.testing.assert_allclose(v, V)
