"""What is done to a log's samples, and which have no stretch that can be used."""

from dataclasses import replace

import numpy as np
import pytest

from backlash.reading.columns import LogOptions
from backlash.refusals import Refusal
from tests.logs import TURN, T, V, frame, opened, refusal

TORQUE = 3 + np.sin(2 * np.pi * T / 0.4) + 0.01 * V


def evenly(v, form=TURN, dt=2e-3):
    return opened(v, form, dt * np.arange(len(v)))


@pytest.mark.parametrize(
    ("per_turn", "modulus", "given"),
    [
        (1, None, {"unit": "turns"}),
        (1, 3, {"unit": "turns"}),
        (2 * np.pi, 1, {"unit": "rad"}),
        (2**12, 2**4, {"unit": "counts", "counts_per_turn": 2.0**12}),
        (-(2**20), 1, {"unit": "counts", "counts_per_turn": 2.0**20}),
        (1000, 10, {"counts_per_turn": 1000}),
        (4000, 25, {"counts_per_turn": 4000}),
    ],
)
def test_a_position_that_starts_anew_is_unwrapped_and_differentiated(per_turn, modulus, given):
    turns = np.cumsum(V) * 2e-3
    position = per_turn * (turns % modulus if modulus else turns)
    log = opened(position, replace(TURN, **given), name="position")
    np.testing.assert_allclose(log.recording.v, V[1:], atol=1e-4)
    note = f"starts anew every {modulus} motor turns: unwrapped"
    assert any(note in each for each in log.notes) == bool(modulus)


def test_a_commanded_speed_resolves_an_encoder_that_wraps_faster_than_it_is_sampled():
    turns = (np.cumsum(V) * 2e-3 * 3.5) % 1.0  # 0.7 turns a sample
    log = opened(turns, replace(TURN, commanded_speed_rps=350.0), name="position [turns]")
    np.testing.assert_allclose(log.recording.v, 3.5 * V[1:], atol=1e-6)


def test_a_fast_log_is_averaged_down_and_of_a_long_one_sixty_turns_are_used():
    log = evenly(100 + 0.1 * np.sin(9e-4 * np.arange(48000)), dt=1e-4)
    assert log.recording.t[1] == pytest.approx(1e-3)
    assert evenly(np.tile(V[:-1], 8)).recording.t[-1] == pytest.approx(24.0)


SPIKED = np.where(np.arange(V.size) == 500, 900.0, V)


@pytest.mark.parametrize(
    ("v", "form", "reason"),
    [
        (V[:6], TURN, "too short: 0.01 s in 6 samples; 4 load turns are needed"),
        (V[:500], TURN, "too short"),
        (np.append(0.0, V[:9]), TURN, "too short"),
        (V - 100.0, TURN, "not constant speed: the motor stands still"),
        (100 * np.sin(3 * T) + 0.1 * V, TURN, "not constant speed: the motor moves to and fro"),
        (V, LogOptions(gear_ratio=1.0), "too short: a load turn of 0.01 s is 5.0 samples long"),
        (V + 0.8 * (T - 2.4), TURN, "not constant speed: it drifts"),
        (np.concatenate([V[:600], 0.5 * V[:600], 1.5 * V[:600]]), TURN, "not constant speed"),
        (60 * V, TURN, "is it in rpm, rad/s"),
        (
            60 * V,
            replace(TURN, gear_ratio=40.0),
            "rps longest, not 100 rps, by gear ratio and turn",
        ),
        (V / 60, replace(TURN, commanded_speed_rps=100.0), "rps longest, not 100 rps, commanded"),
        (SPIKED, TURN, "1 single samples stray from their neighbours, 900 rps"),
        (0 * V + 100, TURN, "never changes, it is 100 throughout"),
        (np.minimum(V, 100.2), TURN, "the speed is clipped at 100.2 in"),
        (
            V,
            LogOptions(turn_period_s=0.4, gear_ratio=32.0, commanded_speed_rps=100.0),
            "wrong period: gear ratio 32 at .* makes turns of 0.32 s",
        ),
    ],
)
def test_a_log_without_a_long_enough_constant_speed_has_no_answer(v, form, reason):
    with pytest.raises(Refusal, match=reason):
        evenly(v, form)


@pytest.mark.parametrize("wave", [0.05, 0.4])
@pytest.mark.parametrize("form", [LogOptions(gear_ratio=40.0), TURN])
def test_within_a_turn_the_speed_may_do_what_the_drive_lets_it(wave, form):
    """Of a soft drive under a heavy load, with a ramp at both ends: all turns, and no ramp."""
    v = 100 + 100 * wave * np.cos(2 * np.pi * T / 0.4)
    ramp = np.linspace(0, 1, 300) * v[0]
    noise = np.random.default_rng(1).normal(0, 0.02, v.size + 600)
    log = evenly(np.concatenate([ramp, v, ramp[::-1]]) + noise, form)
    assert log.recording.turn_period_s == pytest.approx(0.4, rel=0.01)
    assert log.recording.t[-1] > 10 * 0.4
    assert v.min() - 1 < log.recording.v.min()


def test_a_torque_that_is_missing_for_some_rows_is_filled_and_that_is_noted():
    torque = TORQUE.copy()
    torque[[700, 701, 1500]] = np.nan
    form = replace(TURN, torque="moment")
    log = opened(V, form, moment=torque)
    np.testing.assert_allclose(log.torque, TORQUE, atol=0.02)
    assert "left out 3 rows without moment" in log.notes
    torque[200:2200] = np.nan
    assert "too short: 1.0 load turns" in refusal(frame(moment=torque), form)
