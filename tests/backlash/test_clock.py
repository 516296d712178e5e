"""When samples were taken: units and kinds of stamps, the even grid behind them, and what it lacks."""

import numpy as np
import pandas as pd
import pytest

from tests.logs import T, V, file, frame, read, refusal, text

EPOCH = 1_710_000_000
# Seconds as a file may have them, and the unit in which they are read; of the last two it has to be given.
STAMPS = {
    "time [100 ns]": (1e7 * T, "100 ns"),
    "time [days]": (T / 86400, "days"),
    **{
        f"time {unit}": (EPOCH * per + np.rint(per * T).astype("int64"), unit)
        for unit, per in (("ms", 10**3), ("us", 10**6), ("ns", 10**9))
    },
    "a scope's time, from before the trigger": (T - 1.0, "s"),
    "duration as time": (pd.to_timedelta(T, unit="s"), "date-time"),
    "ticks since the year 1": (6.38e17 + np.rint(1e7 * T), "100ns"),
    "days of a spreadsheet": (45_000 + T / 86400, "d"),
}


@pytest.mark.parametrize("name", STAMPS)
def test_stamps_of_every_unit_are_read_or_asked_about_and_it_is_named(name):
    stamps, unit = STAMPS[name]
    log = frame(t=stamps).rename(columns={"time": name.removesuffix(f" {unit}")})
    given = {"time": "1"}
    if "time" not in name:
        assert "--time-unit" in refusal(log, **given)
        assert "the unit 'weeks' of" in refusal(log, time_unit="weeks", **given)
        given |= {"time_unit": unit}
    log = read(log, **given)
    np.testing.assert_allclose(log.recording.t, T, atol=2e-5)
    np.testing.assert_allclose(log.recording.v, V, atol=0.05)
    assert f"[{unit}], speed" in str(log.columns)


def test_at_a_given_rate_stamps_are_ignored_and_rows_without_a_number_stay_holes(tmp_path):
    assert read(frame(t=0 * T), rate_hz=500.0).recording.t[-1] == pytest.approx(4.8)
    rows = text("a,speed [rps]").splitlines()
    rows[500:503] = ["", "0.9,", ""]
    log = read(file(tmp_path, "\n".join(rows)), rate_hz=500.0)
    np.testing.assert_allclose(log.recording.v[510:], V[510:], atol=1e-4)
    assert "missing samples filled from their neighbours: 3" in log.notes


def test_samples_that_a_polling_logger_repeats_are_merged_and_that_is_noted():
    log = read(frame(np.repeat(V, 3), np.repeat(T, 3)))
    np.testing.assert_allclose(log.recording.v, V)
    assert "merged 4802 rows with the time stamp of the next" in log.notes


def test_the_rate_is_compared_with_that_of_the_joints_ring():
    t = np.arange(1200) / 100
    log = frame(np.interp(t % 4.8, T, V), t)
    assert "below 252 Hz the peaks" in read(log).notes[0]
    assert read(log, ring_hz=8.0).notes == ()


# Sampling rate, the samples that were lost, stamps by the time and by what share of a period they are late, and a note.
GRIDS = {
    "lost samples": (500, [5, 1300, 1301], lambda t, late: t, "from their neighbours: 3"),
    "whole milliseconds": (667, [10, 1500], lambda t, late: t.round(3), "taken as even"),
    "late stamps": (200, [], lambda t, late: t + late / 200, "off an even 200 Hz"),
    "one stamp in ten late": (
        2000,
        [],
        lambda t, late: t + np.where(np.arange(t.size) % 10, 0, late) / 2000,
        "off an even 2000 Hz",
    ),
}


@pytest.mark.parametrize("kind", GRIDS)
def test_samples_are_put_back_on_their_grid_and_only_holes_are_filled(kind):
    rate, lost, stamps, note = GRIDS[kind]
    t = np.arange(3200) / rate
    rng = np.random.default_rng(1)
    v = 100 + np.sin(5 * t) + rng.normal(0, 0.1, t.size)
    sampled = np.delete(np.arange(t.size), lost)
    log = read(frame(v[sampled], stamps(t, rng.uniform(0, 0.8, t.size))[sampled]))
    assert log.recording.t[1] == pytest.approx(1 / rate, rel=1e-5)
    assert log.recording.t.size == t.size
    np.testing.assert_allclose(log.recording.v[sampled], v[sampled], rtol=1e-12)
    assert note in " ".join(log.notes)


@pytest.mark.parametrize("are_true", [True, False])
def test_the_jitter_of_a_position_is_told_apart_and_undone(are_true):
    t = 2e-3 * np.arange(2400)
    stamps = t + np.random.default_rng(4).uniform(-1e-4, 1e-4, t.size)
    at = stamps if are_true else t
    turns = 100 * at - 0.6 * np.cos(2 * np.pi * 20 * at) / (2 * np.pi * 20)
    recording = read(frame(turns, stamps, "position"), unit="turns").recording
    middle = recording.t + 1e-3 + (stamps - t).mean()
    assert (recording.v - 100 - 0.6 * np.sin(2 * np.pi * 20 * middle)).std() < 0.01


def test_a_clock_that_drifts_is_followed_and_no_sample_is_made_beyond_the_last():
    true = np.arange(9800) / 490
    true = true[np.random.default_rng(8).random(true.size) > 0.01]
    v = np.interp(true % 4.8, T, V)
    stamps = true + 20 / 490 * np.sin(np.pi * true / 10)
    log = read(frame(v, stamps), turn_period_s=1.0)
    assert "resampled" in " ".join(log.notes)
    assert np.abs(log.recording.v - np.interp(log.recording.t, stamps, v)).std() < 0.05
    assert np.ptp(log.recording.v) < np.ptp(v) + 0.2


def test_of_a_log_with_a_gap_the_side_where_the_motor_goes_farther_is_used():
    k = np.arange(3000 + V.size)
    log = read(frame(np.append(np.zeros(3000), V), 2e-3 * k + np.where(k < 3000, 0.0, 0.1234)))
    np.testing.assert_array_equal(log.recording.v, V)
    assert "used what is between two gaps, from 6.123 to 10.923 s" in log.notes[0]


def test_of_a_log_that_goes_to_and_fro_the_longest_stretch_is_used():
    rest, ramp = np.zeros(150), np.linspace(0, -100, 200)
    v = np.concatenate([rest, V[:1100], rest, ramp, -V, ramp[::-1], rest, V[:1100]])
    v += np.random.default_rng(1).normal(0, 0.01, v.size)
    log = read(frame(v))
    assert 0.9 * V.size < log.recording.v.size <= V.size
    assert abs(log.recording.v - 100).max() < 1.5
    assert any("turns backward" in note for note in log.notes)


def test_the_part_between_from_and_to_is_used():
    v = np.where(np.arange(V.size) == 3, 1e9, V)
    log = read(frame(v, T + 7.0), start_s=1.0, end_s=4.0)
    np.testing.assert_array_equal(log.recording.v, V[500:2001])
