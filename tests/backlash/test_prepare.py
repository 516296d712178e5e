"""What is done to a log's samples, and which have no stretch that can be used."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash.reading.columns import LogFormat
from backlash.reading.prepare import open_log
from backlash.refusals import Refusal
from tests.logs import TURN, noisy, opened, refusal

RECORD = noisy()


def evenly(v, form=TURN, dt=2e-3):
    return opened(dt * np.arange(len(v)), v, form)


@pytest.mark.parametrize(
    ("scale", "wrap", "said"),
    [
        (1.0, None, {"unit": "rps"}),
        (2 * np.pi, 2 * np.pi, {"unit": "rad/s"}),
        (2**12, 2**16, {"unit": "counts", "counts_per_turn": 2.0**12}),
    ],
)
def test_a_position_is_unwrapped_and_differentiated(scale, wrap, said):
    position = scale * np.cumsum(RECORD.v) * 2e-3
    log = opened(
        RECORD.t, position if wrap is None else position % wrap, replace(TURN, **said), "position"
    )
    np.testing.assert_allclose(log.recording.v, RECORD.v[1:], atol=1e-4)
    assert any("differentiated" in note for note in log.notes)
    assert any("unwrapped" in note for note in log.notes) == (wrap is not None)


@settings(max_examples=20)
@given(
    speed=st.floats(20, 240),
    direction=st.sampled_from([1.0, -1.0]),
    start=st.floats(0, 1),
    bits=st.integers(10, 20),
)
def test_wrapping_changes_nothing_as_long_as_a_sample_is_less_than_half_a_turn(
    speed, direction, start, bits
):
    t = 2e-3 * np.arange(1500)
    counts = np.floor((start + direction * speed * t) * 2**bits)
    form = LogFormat(unit="counts", counts_per_turn=2.0**bits, gear_ratio=speed / 2.5)
    found = [
        opened(t, position, form, "position").recording.v for position in (counts, counts % 2**bits)
    ]
    np.testing.assert_array_equal(*found)


def test_a_position_that_goes_on_evenly_has_one_speed():
    t = 2e-3 * np.arange(2000)
    log = opened(t, 100 * t, replace(TURN, unit="rps"), "position")
    assert log.recording.v == pytest.approx(100)


def test_a_commanded_speed_resolves_an_encoder_that_wraps_faster_than_it_is_sampled():
    turns = (np.cumsum(RECORD.v) * 2e-3 * 3.5) % 1.0  # 0.7 turns a sample
    log = opened(RECORD.t, turns, replace(TURN, commanded_speed_rps=350.0), "position [turns]")
    np.testing.assert_allclose(log.recording.v, 3.5 * RECORD.v[1:], atol=1e-6)


def test_a_fast_log_is_averaged_down():
    log = evenly(100 + 0.1 * np.sin(9e-4 * np.arange(48000)), dt=1e-4)
    assert log.recording.t[1] == pytest.approx(1e-3)
    assert any("averaged over 10" in note for note in log.notes)


def test_only_the_first_sixty_turns_of_a_long_log_are_used():
    assert evenly(np.tile(RECORD.v[:-1], 8)).recording.t[-1] == pytest.approx(24.0)


@pytest.mark.parametrize("factor", [60, 1 / 60, 6.2832])
@pytest.mark.parametrize("known", [{"commanded_speed_rps": 100.0}, {"gear_ratio": 40.0}])
def test_a_wrong_unit_is_told_by_what_is_known_of_the_speed(factor, known):
    frame = pd.DataFrame({"t": RECORD.t, "v [rps]": factor * RECORD.v})
    assert "rps longest, not 100 rps" in refusal(frame, replace(TURN, **known))


def test_a_speed_that_no_motor_reaches_is_asked_about():
    assert "is it in rpm, rad/s" in refusal(pd.DataFrame({"t": RECORD.t, "v [rps]": 60 * RECORD.v}))


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"turn_period_s": -1.0},
        {"turn_period_s": 0.4, "speed": "a", "position": "b"},
        {"turn_period_s": 0.4, "unit": "mph"},
        {"turn_period_s": 0.4, "start_s": 1.0, "end_s": 1.0},
        {"turn_period_s": 0.4, "start_s": float("nan")},
    ],
)
def test_options_that_make_no_sense_are_refused(wrong):
    with pytest.raises(Refusal, match=r"give |there are"):
        LogFormat(**wrong)


@pytest.mark.parametrize(
    ("v", "reason"),
    [
        (RECORD.v[:500], "too short"),
        (np.append(0.0, RECORD.v[:9]), "too short"),
        (RECORD.v - 100.0, "not constant speed: the motor stands still"),
        (100 * np.sin(3 * RECORD.t) + 0.1 * RECORD.v, "not constant speed"),
        (RECORD.v + 0.8 * (RECORD.t - 2.4), "not constant speed: it drifts"),
        (
            np.concatenate([RECORD.v[:600], 0.5 * RECORD.v[:600], 1.5 * RECORD.v[:600]]),
            "not constant speed",
        ),
    ],
)
def test_a_log_without_a_long_enough_constant_speed_has_no_answer(v, reason):
    with pytest.raises(Refusal, match=reason):
        evenly(v)


def test_a_gear_ratio_that_contradicts_the_turn_period_has_no_answer():
    with pytest.raises(Refusal, match=r"wrong period: gear ratio 32 at .* makes turns of 0.32 s"):
        evenly(RECORD.v, replace(TURN, gear_ratio=32.0, commanded_speed_rps=100.0))


@pytest.mark.parametrize("wave", [0.05, 0.2, 0.4])
@pytest.mark.parametrize("form", [LogFormat(gear_ratio=40.0), TURN])
def test_within_a_turn_the_speed_may_do_what_the_drive_lets_it(wave, form):
    """Of a soft drive under a heavy load, with a ramp at both ends: all turns, and no ramp."""
    phase = np.arange(0, 12, 1 / 200)
    course = 100 / (1 + wave * np.cos(2 * np.pi * phase))
    t = np.append(0, np.cumsum(1 / 80 / course * 16))
    even = np.arange(0, t[-2], 2e-3)
    v = np.interp(even, t[:-1], course)
    rng = np.random.default_rng(1)
    ramp = np.linspace(0, 1, 300) * v[0]
    log = evenly(np.concatenate([ramp, v, ramp[::-1]]) + rng.normal(0, 0.02, even.size + 600), form)
    assert log.recording.turn_period_s == pytest.approx(0.4, rel=0.01)
    assert log.recording.t[-1] > 10 * 0.4
    assert v.min() - 1 < log.recording.v.min()


TORQUE = 3 + np.sin(2 * np.pi * RECORD.t / 0.4) + 0.01 * RECORD.v


def with_torque(torque) -> pd.DataFrame:
    return pd.DataFrame({"time": RECORD.t, "speed [rps]": RECORD.v, "I [A]": torque})


def test_a_torque_that_is_missing_for_some_rows_is_filled_and_that_is_noted():
    torque = TORQUE.copy()
    torque[[700, 701, 1500]] = np.nan
    log = open_log(with_torque(torque), replace(TURN, torque="I [A]"))
    np.testing.assert_allclose(log.torque, TORQUE, atol=0.02)
    assert "left out 3 rows without I [A]" in log.notes
    torque[200:2200] = np.nan
    with pytest.raises(Refusal, match=r"too short: 1\.0 load turns") as caught:
        open_log(with_torque(torque), replace(TURN, torque="I [A]"))
    assert "used what is between two gaps, from 4.400 to 4.800 s" in caught.value.notes[-1]


@pytest.mark.parametrize("limits", [(-9.0, 4.2), (3.2, 9.0)])
def test_a_clipped_torque_or_speed_is_named(limits):
    said = refusal(with_torque(np.clip(TORQUE, *limits)), replace(TURN, torque="I [A]"))
    assert "the torque is clipped at" in said
    clipped = with_torque(TORQUE).assign(**{"speed [rps]": np.minimum(RECORD.v, 100.2)})
    assert "the speed is clipped at 100.2 rps" in refusal(clipped)


def test_a_spike_and_a_column_that_never_changes_are_named():
    v = RECORD.v.copy()
    v[500] = 900.0
    spiked = with_torque(TORQUE).assign(**{"speed [rps]": v})
    assert "1 single samples stray from their neighbours, 900 rps" in refusal(spiked)
    still = with_torque(TORQUE).assign(**{"speed [rps]": 100.0})
    assert "never changes, it is 100 throughout" in refusal(still)
