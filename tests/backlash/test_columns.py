"""Which columns are read, in which units: the motor's measured ones, by name; what may be several things is asked."""

import numpy as np
import pandas as pd
import pytest

from backlash.reading.columns import choose_columns
from backlash.reading.tables import Table
from backlash.refusals import Refusal
from tests.logs import V, asked, file, frame, read, refusal, text

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
NO_MEASUREMENTS = ("target", "cmd", "set", "ref", "desired", "soll", "delta")
# A log's columns, and what the answer, or a question, says of them.
SAID = {
    **{
        f"time,{name}": f"time 'time' [], speed {name!r} [{unit}], the motor's side"
        for unit, names in SPELLINGS.items()
        for name in names
    },
    **{f"time,{name}": "is not known; give --unit (a speed's: rps, rpm" for name in ASKED},
    **{f"time,{word} speed [rps],current": "give --speed" for word in NO_MEASUREMENTS},
    "time,speed [rps],motor speed [rpm]": "speed 'motor speed [rpm]' [rpm], the motor's side",
    "time,position [rev],motor encoder [rev]": "position 'motor encoder [rev]' [turns]",
    "time,joint velocity [rps],speed [rps]": "speed 'speed [rps]'",
    "time,flange speed [rps],speed [rps]": "speed 'speed [rps]'",
    "time,speed [rps],position [rev]": "speed 'speed [rps]'",
    "time,target speed [rps],speed [rps]": "speed 'speed [rps]'",
    "time,speed_cmd_rps,motor speed [rps]": "speed 'motor speed [rps]'",
    "time,header.stamp,recv_time,speed [rps]": "time 'header.stamp'",
    "time,recv_time,speed [rps]": "time 'time'",
    "[s],speed [rps]": "time '[s]'",
    "timestamps,speed [rps]": "time 'timestamps'",
    "Stempel [ms],speed [rps]": "time 'Stempel [ms]'",
    "time,Solllage [°],Istposition [°]": "position 'Istposition [°]' [deg], the motor's side",
    "time,Motorsolldrehzahl [rpm],Istdrehzahl [rpm]": "speed 'Istdrehzahl [rpm]'",
    "time,Lastposition [rad],Motorposition [rad]": "position 'Motorposition [rad]'",
    "time,speed in 0.1 rpm": "of a scaled one, like 0.1 rpm, give --unit counts, and as --counts",
    "time,speed [rps],velocity [rps]": "give --speed",
    "time,dq[0],dq[1]": "give --speed",
    "time,speed [counts/s]": "give --counts-per-turn",
    "time,speed [rps],timestamp": "which column is the time: 'time', 'timestamp'? give",
}
SAID_BY_OPTIONS = [
    *((f"time,{name}", {"unit": "rpm"}, f"speed {name!r} [rpm]") for name in ASKED),
    ("time,speed", {"counts_per_turn": 4096}, "speed 'speed' [counts]"),
    ("time,speed [rpm]", {"counts_per_turn": 4096}, "speed 'speed [rpm]' [rpm]"),
    ("time,speed [rps]", {"gear_ratio": 40.0}, "the motor's side"),
    ("time,speed [rps]", {"gear_ratio": 1.0}, "the joint's side"),
    ("time,joint speed [rps]", {"gear_ratio": 40.0, "speed": "2"}, "the joint's side"),
    ("time,joint speed [rps]", {"gear_ratio": 40.0}, "is the joint's side of the gear by its"),
    ("time,Speed[rps],MotorTorque[Nm]", {"torque": "MotorTorque"}, "torque 'MotorTorque[Nm]'"),
    ("time,v [rps],motor_torque [Nm]", {"torque": "Motor torque"}, "torque 'motor_torque [Nm]'"),
    ("time,motor speed [rpm],speed [rps]", {"speed": "Motor speed [rpm]"}, "'motor speed [rpm]'"),
    ("time,speed [rpm],speed [rps]", {"speed": "speed"}, "no column 'speed'"),
    ("time,speed [rps]", {"speed": "x"}, "no column 'x'; there are 'time', 'speed [rps]'"),
    ("time,speed [rps]", {"speed": "9"}, "no column '9'"),
    ("time,speed [rps]", {"speed": "1"}, "signal 'time' and torque '' cannot be one column"),
    ("time,speed [rps]", {"unit": "rpm"}, "says rps, --unit says rpm; leave --unit out"),
    ("time,speed", {"unit": "mph"}, "the unit 'mph' of 'speed' is not known; give --unit (a"),
    ("time,speed [rps],moment,t2 [s]", {"torque": "moment", "time": "1"}, "stamps of its"),
    ("time,speed [rps],t2 [s],moment", {"torque": "moment", "time": "1"}, "stamps of its"),
]


def choose(header: str, **given) -> str:
    """What is said of the columns of a header that are chosen, or why none are."""
    table = pd.DataFrame({name: [k, k + 1.0] for k, name in enumerate(header.split(","))})
    try:
        return str(choose_columns(Table(table), asked(**given)))
    except Refusal as refusal:
        return str(refusal)


@pytest.mark.parametrize("header", SAID)
def test_the_motors_measured_columns_are_read_or_asked_about_where_they_may_be_two(header):
    assert SAID[header] in choose(header)


@pytest.mark.parametrize(("header", "given", "words"), SAID_BY_OPTIONS)
def test_columns_that_are_given_are_read_or_refused(header, given, words):
    assert words in choose(header, **given)


@pytest.mark.parametrize("unit", PER_TURN)
def test_a_speed_is_converted_from_its_unit(unit):
    log = read(frame(PER_TURN[unit] * V, name=f"speed [{unit}]"))
    np.testing.assert_allclose(log.recording.v, V)


def test_numbers_of_columns_are_the_files_whatever_these_hold(tmp_path):
    header = "time,comment,state,speed [rps],,moment,speed [rps]"
    path = file(tmp_path, text(header, "{t:.4f},,on,{v:.5f},,{rpm:.3f},7"))
    log = read(path, speed="4", torque="6")
    np.testing.assert_allclose(60 * log.recording.v, log.torque, atol=1e-3)
    assert "speed 'speed [rps] (4)' [rps], torque 'moment'" in str(log.columns)
    assert "'5' is empty in all 2,401 rows" in refusal(path, speed="5", unit="rps")
