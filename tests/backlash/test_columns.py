"""Which columns are read, in which units: the motor's measured ones, by name; what may be several things is asked."""

import re

import numpy as np
import pandas as pd
import pytest

from backlash.reading.columns import Columns, choose_columns
from backlash.reading.tables import Table
from tests.logs import V, asked, file, frame, read, refusal, refused_for, text

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
NAMES = ["motor speed [rpm]", "motor speed [rad/s]", "current [A]"]
# The columns beside the time, what is given of them, and what the answer says of them.
CHOSEN = [
    (["speed [rps]", "motor speed [rpm]"], {}, "speed 'motor speed [rpm]' [rpm], the motor's side"),
    (["position [rev]", "motor encoder [rev]"], {}, "position 'motor encoder [rev]' [turns]"),
    (["joint velocity [rps]", "speed [rps]"], {}, "speed 'speed [rps]'"),
    (["flange speed [rps]", "speed [rps]"], {}, "speed 'speed [rps]'"),
    (["speed [rps]", "position [rev]"], {}, "speed 'speed [rps]'"),
    (["target speed [rps]", "speed [rps]"], {}, "speed 'speed [rps]'"),
    (["speed_cmd_rps", "motor speed [rps]"], {}, "speed 'motor speed [rps]'"),
    (["header.stamp", "recv_time", "speed [rps]"], {}, "time 'header.stamp'"),
    (["recv_time", "speed [rps]"], {}, "time 'time'"),
    (["speed"], {"counts_per_turn": 4096}, "speed 'speed' [counts]"),
    (["speed [rpm]"], {"counts_per_turn": 4096}, "speed 'speed [rpm]' [rpm]"),
    (["speed [rps]"], {"gear_ratio": 40.0}, "the motor's side"),
    (["speed [rps]"], {"gear_ratio": 1.0}, "the joint's side"),
    (["joint speed [rps]"], {"gear_ratio": 40.0, "speed": "2"}, "the joint's side"),
    (
        NAMES,
        {"speed": "Motor speed [rpm]", "torque": "current"},
        "speed 'motor speed [rpm]' [rpm], torque 'current [A]'",
    ),
    *(([name], {"unit": "rpm"}, f"speed {name!r} [rpm]") for name in ASKED),
    (["Solllage [°]", "Istposition [°]"], {}, "position 'Istposition [°]' [deg], the motor's side"),
    (["Motorsolldrehzahl [rpm]", "Istdrehzahl [rpm]"], {}, "speed 'Istdrehzahl [rpm]'"),
    (["Lastposition [rad]", "Motorposition [rad]"], {}, "position 'Motorposition [rad]'"),
    (["Speed[rps]", "MotorTorque[Nm]"], {"torque": "MotorTorque"}, "torque 'MotorTorque[Nm]'"),
    (["Speed[rps]", "motor_torque [Nm]"], {"torque": "Motor torque"}, "torque 'motor_torque [Nm]'"),
]
TIMES = ["[s]", "timestamps", "Stempel [ms]"]
REFUSED = [
    *(([name], {}, "is not known; give --unit (a speed's: rps, rpm") for name in ASKED),
    (
        ["speed in 0.1 rpm"],
        {},
        "of a scaled one, like 0.1 rpm, give --unit counts, and as --counts",
    ),
    (["speed [rps]", "velocity [rps]"], {}, "give --speed"),
    (["dq[0]", "dq[1]"], {}, "give --speed"),
    *(
        ([f"{word} speed [rps]", "current"], {}, "give --speed")
        for word in ("target", "cmd", "set", "ref", "desired", "soll", "delta")
    ),
    (["speed [rps]"], {"speed": "x"}, "no column 'x'; there are 'time', 'speed [rps]'"),
    (["speed [rps]"], {"speed": "9"}, "no column '9'"),
    (["speed"], {"unit": "mph"}, "the unit 'mph' of 'speed' is not known; give --unit (a speed's:"),
    (["speed [rps]"], {"speed": "1"}, "signal 'time' and torque '' cannot be one column"),
    (["speed [rps]"], {"unit": "rpm"}, "says rps, --unit says rpm; leave --unit out"),
    (["speed [counts/s]"], {}, "give --counts-per-turn"),
    (NAMES, {"speed": "motor speed"}, "no column 'motor speed'"),
    (["joint speed [rps]"], {"gear_ratio": 40.0}, "is the joint's side of the gear by its"),
    (["speed [rps]", "timestamp"], {}, "which column is the time: 'time', 'timestamp'? give"),
    (["speed [rps]", "moment", "t2 [s]"], {"torque": "moment", "time": "1"}, "stamps of its"),
    (["speed [rps]", "t2 [s]", "moment"], {"torque": "moment", "time": "1"}, "stamps of its"),
]


def choose(names, given) -> Columns:
    table = pd.DataFrame({name: [k, k + 1.0] for k, name in enumerate(["time", *names])})
    return choose_columns(Table(table), asked(**given))


@pytest.mark.parametrize(
    ("unit", "name"), [(u, name) for u, names in SPELLINGS.items() for name in names]
)
def test_a_column_is_read_in_the_unit_of_its_name_and_both_are_in_the_answer(unit, name):
    log = read(frame(PER_TURN[unit] * V, name=name))
    np.testing.assert_allclose(log.recording.v, V)
    assert str(log.columns) == f"time 'time' [s], speed {name!r} [{unit}], the motor's side"


@pytest.mark.parametrize(("names", "given", "words"), CHOSEN)
def test_the_motors_measured_columns_are_read_or_those_that_are_given(names, given, words):
    assert words in str(choose(names, given))


@pytest.mark.parametrize(("names", "given", "why"), REFUSED)
def test_columns_that_cannot_be_or_may_be_two_are_asked_about(names, given, why):
    with refused_for(re.escape(why)):
        choose(names, given)


def test_numbers_of_columns_are_the_files_whatever_these_hold(tmp_path):
    header = "time,comment,state,speed [rps],,moment,speed [rps]"
    path = file(tmp_path, text(header, "{t:.4f},,on,{v:.5f},,{rpm:.3f},7"))
    log = read(path, speed="4", torque="6")
    np.testing.assert_allclose(60 * log.recording.v, log.torque, atol=1e-3)
    assert "speed 'speed [rps] (4)' [rps], torque 'moment'" in str(log.columns)
    assert "'5' is empty in all 2,401 rows" in refusal(path, speed="5", unit="rps")


@pytest.mark.parametrize("name", TIMES)
def test_a_time_is_told_by_its_name_or_its_unit(name):
    chosen = choose_columns(
        Table(pd.DataFrame({"speed [rps]": [1.0, 2.0], name: [0.0, 1.0]})), asked()
    )
    assert chosen.time == name
