from dataclasses import replace

import numpy as np
import pytest

from backlash.refusals import Refusal
from tests.logs import TURN, noisy, opened

PER_TURN = {"rps": 1.0, "rpm": 60.0, "rad/s": 2 * np.pi, "deg/s": 360.0}
SPELLINGS = {
    "rps": [
        "speed_rps",
        "speed [rev/s]",
        "speed [1/s]",
        "speed (s^-1)",
        "motor_vel_rev_per_s",
        "speed [Hz]",
    ],
    "rpm": [
        "Drehzahl [U/min]",
        "speed [min^-1]",
        "speed 1/min",
        "motorSpeedRPM",
        "speed [min⁻¹]",
        "speed [r/min]",
        "speed [rev/min]",
        "Drehzahl [1/min] für Achse 5 °",
    ],
    "rad/s": [
        "speed_rad_s",
        "motor_vel_rad_per_s",
        "speed [rad s^-1]",
        "speed_radps",
        "speed [rad·s⁻¹]",
        "speed [rad/s]",
        "motorSpeedRadPerSec",
        "speed [rad/s] (2)",
    ],
    "deg/s": ["speed_deg_s", "speed [deg/s]", "speed [°/s]", "speed_deg_per_sec"],
}


def notes_and_speed(name, factor=1.0, form=TURN):
    log = opened(noisy().t, factor * noisy().v, form, name)
    return log.notes, log.recording.v


@pytest.mark.parametrize(
    ("unit", "name"), [(unit, name) for unit, names in SPELLINGS.items() for name in names]
)
def test_a_column_is_read_in_the_unit_of_its_name(unit, name):
    notes, v = notes_and_speed(name, PER_TURN[unit])
    np.testing.assert_allclose(v, noisy().v)
    assert notes == ()


@pytest.mark.parametrize(
    "name", ["speed [m/s]", "speed [knots]", "speed (filtered)", "speed_m_s", "speed_min"]
)
def test_an_unknown_unit_is_an_error_unless_it_is_given(name):
    with pytest.raises(
        Refusal, match=r"of 'speed.* is not known; give --unit, one of rps, rpm, rad/s, deg/s"
    ):
        notes_and_speed(name)
    np.testing.assert_allclose(notes_and_speed(name, 60.0, replace(TURN, unit="rpm"))[1], noisy().v)


@pytest.mark.parametrize("name", ["speed", "velocity[0]", "speed (2)"])
def test_a_speed_without_a_unit_is_taken_as_rps_and_that_is_said(name):
    notes, v = notes_and_speed(name)
    np.testing.assert_allclose(v, noisy().v)
    assert notes == ("unit of the speed not said: taken as rps",)


def test_counts_per_turn_imply_counts_where_no_unit_is_named():
    form = replace(TURN, counts_per_turn=4096.0)
    np.testing.assert_allclose(notes_and_speed("speed", 4096.0, form)[1], noisy().v)
    np.testing.assert_allclose(notes_and_speed("speed [rpm]", 60.0, form)[1], noisy().v)
    position = np.cumsum(noisy().v) * 2e-3
    log = opened(noisy().t, 4096 * position, form, "position")
    np.testing.assert_allclose(log.recording.v, noisy().v[1:])


@pytest.mark.parametrize(
    ("name", "unit"),
    [("speed [rpm]", None), ("speed_rad_s", None), ("speed", "rpm"), ("speed", "rad/s")],
)
def test_a_speed_of_another_machine_is_read_if_its_unit_is_named(name, unit):
    form = replace(TURN, unit=unit)
    per_turn = 60.0 if "rpm" in (unit or name) else 2 * np.pi
    np.testing.assert_allclose(notes_and_speed(name, form=form)[1], noisy().v / per_turn)
