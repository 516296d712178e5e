from dataclasses import replace

import numpy as np
import pytest

from backlash.reading.columns import LogFormat
from backlash.refusals import Refusal
from tests.logs import TURN, noisy, opened


def without(places, t, v):
    return np.delete(t, places), np.delete(v, places)


@pytest.mark.parametrize(
    "places", [[1000], [3], [2396], [700, 1500], [700, 701], [5, 1200, 1300, 1301, 2390]]
)
def test_only_the_holes_of_dropped_samples_are_filled(places):
    log = opened(*without(places, noisy().t, noisy().v))
    kept = np.setdiff1d(np.arange(noisy().t.size), places)
    np.testing.assert_allclose(log.recording.t, noisy().t, atol=1e-9)
    np.testing.assert_allclose(log.recording.v[kept], noisy().v[kept], rtol=1e-12)
    assert abs(log.recording.v[places] - noisy().v[places]).max() < 0.5
    assert log.notes == (f"missing samples filled from their neighbours: {len(places)}",)


@pytest.mark.parametrize("rate", [667.0, 300.0, 600.0])
@pytest.mark.parametrize("places", [[], [400], [10, 1500]])
def test_stamps_rounded_to_a_millisecond_are_put_back_on_their_grid(rate, places):
    t = np.arange(3200) / rate
    v = 100 + np.sin(5 * t) + np.random.default_rng(1).normal(0, 0.1, t.size)
    kept = np.delete(np.arange(t.size), places)
    log = opened(t[kept].round(3), v[kept])
    np.testing.assert_allclose(log.recording.t, t, atol=2e-6)
    np.testing.assert_allclose(log.recording.v[kept], v[kept], rtol=1e-12)
    assert any("taken as even" in note for note in log.notes)


@pytest.mark.parametrize("jitter_s", [1e-4, 3e-4])
def test_whether_stamps_are_late_or_samples_uneven_is_told_by_the_signal(jitter_s):
    rng = np.random.default_rng(3)
    t = 2e-3 * np.arange(2400)
    stamps = t + rng.uniform(-jitter_s, jitter_s, t.size)
    noise = rng.normal(0, 0.02, t.size)

    def course(at):
        return 100 + 0.6 * np.sin(2 * np.pi * 20 * at)

    log = opened(stamps, course(t) + noise)
    assert "taken as even" in log.notes[0]
    np.testing.assert_array_equal(log.recording.v, course(t) + noise)
    log = opened(stamps, course(stamps) + noise)
    assert "resampled" in log.notes[0]
    off = (log.recording.v - course(log.recording.t + stamps.mean() - log.recording.t.mean())).std()
    assert off < 1.03 * noise.std()


@pytest.mark.parametrize("are_true", [True, False])
def test_the_jitter_of_a_position_is_told_apart_and_undone(are_true):
    t = 2e-3 * np.arange(2400)
    stamps = t + np.random.default_rng(4).uniform(-1e-4, 1e-4, t.size)
    at = stamps if are_true else t
    turns = 100 * at - 0.6 * np.cos(2 * np.pi * 20 * at) / (2 * np.pi * 20)
    dropped = [300, 301, 1700]
    form = replace(TURN, unit="counts", counts_per_turn=2.0**19)
    log = opened(*without(dropped, stamps, np.floor(2**19 * (turns % 1.0))), form, "position")
    middle = log.recording.t + 1e-3 + (stamps - t).mean()
    assert (log.recording.v - 100 - 0.6 * np.sin(2 * np.pi * 20 * middle)).std() < 0.01


def test_of_a_constant_speed_with_a_gap_the_longer_side_is_used_if_it_has_four_turns():
    t, v = without(slice(1000, 1010), noisy().t, noisy().v)
    log = opened(t, v)
    np.testing.assert_array_equal(log.recording.v, noisy().v[1010:])
    assert log.notes == ("used the constant speed from 2.020 to 4.800 s of 4.800 s",)
    ramp = np.linspace(0, 100, 300) + np.random.default_rng(1).normal(0, 0.1, 300)
    v = np.concatenate([ramp, noisy().v])
    t = 2e-3 * np.arange(v.size) + np.where(np.arange(v.size) > 100, 0.1234, 0.0)
    assert opened(t, v).recording.t[-1] > 4.5


@pytest.mark.parametrize("forward_is_longer", [True, False])
def test_of_a_log_that_goes_to_and_fro_the_longest_stretch_is_used(forward_is_longer):
    rest, ramp = np.zeros(150), np.linspace(0, 100, 200)
    short, long = noisy().v[:1100], noisy().v
    there, back = (long, short) if forward_is_longer else (short, long)
    cycle = [ramp, there, ramp[::-1], rest, -ramp, -back, -ramp[::-1], rest]
    v = np.concatenate([rest, *cycle, ramp, short, ramp[::-1]])
    v += np.random.default_rng(1).normal(0, 0.01, v.size)
    log = opened(2e-3 * np.arange(v.size), v)
    assert 0.9 * long.size < log.recording.v.size <= long.size
    assert abs(log.recording.v - 100).max() < 1.5
    assert sum("used the constant speed from" in note for note in log.notes) == 1
    assert any("turns backward" in note for note in log.notes) == (not forward_is_longer)


def test_a_log_that_goes_to_and_fro_without_rest_uses_one_stretch():
    v = np.concatenate([noisy().v[:1200], -noisy().v[:1000]] * 3)
    log = opened(2e-3 * np.arange(v.size), v)
    assert 1000 < log.recording.v.size <= 1200


def test_the_part_between_from_and_to_is_used():
    log = opened(noisy().t + 7.0, noisy().v, replace(TURN, start_s=1.0, end_s=4.0))
    np.testing.assert_array_equal(log.recording.v, noisy().v[500:2001])
    assert log.recording.t[0] == 0.0
    assert log.notes == ("used 1501 of 2401 samples, by --from and --to",)
    v = noisy().v.copy()
    v[3], v[2300] = 1e9, -50.0
    assert opened(noisy().t, v, replace(TURN, start_s=0.1, end_s=4.0)).recording.v.size == 1951
    with pytest.raises(Refusal, match=r"no samples between --from and --to; the log lasts 4.8 s"):
        opened(noisy().t, noisy().v, replace(TURN, start_s=10.0))
    with pytest.raises(Refusal, match="too short"):
        opened(noisy().t, noisy().v, replace(TURN, end_s=1.0))


def test_a_clock_that_drifts_is_followed_and_no_sample_is_made_beyond_the_last():
    """With late stamps, gaps of 8 ms and 1 % lost samples."""
    rng = np.random.default_rng(8)
    true = np.arange(20 * 490) / 490
    v = 1 + 0.01 * (np.interp(true % 4.8, noisy().t, noisy().v) - 100)
    v += rng.normal(0, 1e-4, true.size)
    stamps = true + 20 / 490 * np.sin(np.pi * true / 10) + rng.uniform(0, 2e-4, true.size)
    lost = rng.random(true.size) < 0.01
    for gap in (500, 1700, 2800):
        lost[gap : gap + 3] = True
    true, v = true[~lost], v[~lost]
    log = opened(stamps[~lost], v, LogFormat(turn_period_s=1.0))
    assert "a clock that drifts, followed" in log.notes[0]
    assert v.min() - 0.002 < log.recording.v.min()
    assert log.recording.v.max() < v.max() + 0.002
    at = log.recording.t + true[0]
    assert np.abs(log.recording.v - np.interp(at, true, v)).std() < 2e-3
