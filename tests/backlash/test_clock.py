"""When samples were taken: units and kinds of stamps, their order, the even grid behind them, and what it lacks."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from backlash.reading.columns import LogOptions
from backlash.reading.prepare import open_log
from tests.logs import TURN, T, V, file, frame, opened, refusal, text

EPOCH = 1_710_000_000
# Seconds as a file may have them, and the unit in which they are read; of the last two it has to be given.
STAMPS = {
    "100 ns by name": ("time [100 ns]", 1e7 * T, "100 ns"),
    "days by name": ("time [days]", T / 86400, "days"),
    **{
        f"{unit} since 1970": ("timestamp", EPOCH * per + np.rint(per * T).astype("int64"), unit)
        for unit, per in (("ms", 10**3), ("us", 10**6), ("ns", 10**9))
    },
    "a scope's, from before the trigger": ("time", T - 1.0, "s"),
    "durations": ("time", pd.to_timedelta(T, unit="s"), "date-time"),
    "ticks since the year 1": ("ticks since the year 1", 6.38e17 + np.rint(1e7 * T), "100ns"),
    "days of a spreadsheet": ("days of a spreadsheet", 45_000 + T / 86400, "d"),
}


@pytest.mark.parametrize("kind", STAMPS)
def test_stamps_of_every_unit_are_read_or_asked_about_and_it_is_named(kind):
    name, stamps, unit = STAMPS[kind]
    log, form = frame(t=stamps).rename(columns={"time": name}), replace(TURN, time=name)
    if name == kind:
        assert "--time-unit" in refusal(log, form)
        assert "the unit 'weeks' of" in refusal(log, replace(form, time_unit="weeks"))
        form = replace(form, time_unit=unit)
    read = open_log(log, form)
    np.testing.assert_allclose(read.recording.t, T, atol=2e-5)
    np.testing.assert_allclose(read.recording.v, V, atol=0.05)
    assert f"time {name!r} [{unit}]" in str(read.columns)


def bursts(together: int) -> np.ndarray:
    """Stamps in groups that are 0.1 ms apart, at 500 Hz in the mean."""
    k = np.arange(T.size)
    return k // together * together * 2e-3 + k % together * 1e-4


@pytest.mark.parametrize(
    ("t", "why"),
    [
        (np.append(T, T), "run backward (0 s follow 4.8 s after the first; 1 such rows)"),
        (T[::-1], "start anew or run backward"),
        (np.floor(250 * T) / 250, "repeats the one before with other values"),
        (0.1 * np.arange(T.size), "sampled at 10 Hz; a ring of 21 Hz after an impact needs 84 Hz"),
        (bursts(2), "samples a second: give --rate 500"),
        (T[np.random.default_rng(5).random(T.size) > 0.2], "would be invented"),
    ],
)
def test_stamps_that_cannot_be_are_refused_for_what_they_are(t, why):
    assert why in refusal(frame(t=t))


def test_at_a_given_rate_stamps_are_ignored_and_rows_without_a_number_stay_holes(tmp_path):
    assert opened(V, replace(TURN, rate_hz=500.0), bursts(4)).recording.t[-1] > 4.7
    rows = text("a,speed [rps]").splitlines()
    rows[500:503] = ["", "0.9,", ""]
    log = open_log(file(tmp_path, "\n".join(rows)), replace(TURN, rate_hz=500.0))
    np.testing.assert_allclose(log.recording.v[510:], V[510:], atol=1e-4)
    assert "missing samples filled from their neighbours: 3" in log.notes


def test_samples_that_a_polling_logger_repeats_are_merged_and_that_is_noted():
    log = opened(np.repeat(V, 3), t=np.repeat(T, 3))
    np.testing.assert_allclose(log.recording.v, V)
    assert "merged 4802 rows with the time stamp of the next" in log.notes


def test_the_least_rate_is_that_of_the_joints_ring():
    t = np.arange(1200) / 100
    v = np.interp(t % 4.8, T, V)
    assert "below 252 Hz the peaks" in opened(v, t=t).notes[0]
    assert opened(v, replace(TURN, ring_hz=8.0), t).notes == ()
    assert "a ring of 30 Hz after an impact needs 120 Hz" in refusal(
        frame(v, t), replace(TURN, ring_hz=30.0)
    )


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
    log = opened(v[sampled], t=stamps(t, rng.uniform(0, 0.8, t.size))[sampled])
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
    recording = opened(turns, replace(TURN, unit="turns"), stamps, "position").recording
    middle = recording.t + 1e-3 + (stamps - t).mean()
    assert (recording.v - 100 - 0.6 * np.sin(2 * np.pi * 20 * middle)).std() < 0.01


def test_a_clock_that_drifts_is_followed_and_no_sample_is_made_beyond_the_last():
    true = np.arange(9800) / 490
    true = true[np.random.default_rng(8).random(true.size) > 0.01]
    v = np.interp(true % 4.8, T, V)
    stamps = true + 20 / 490 * np.sin(np.pi * true / 10)
    log = opened(v, LogOptions(turn_period_s=1.0), stamps)
    assert "resampled" in " ".join(log.notes)
    assert np.abs(log.recording.v - np.interp(log.recording.t, stamps, v)).std() < 0.05
    assert np.ptp(log.recording.v) < np.ptp(v) + 0.2


def test_of_a_log_with_a_gap_the_side_where_the_motor_goes_farther_is_used():
    v = np.concatenate([np.zeros(3000), V])
    t = 2e-3 * np.arange(v.size) + np.where(np.arange(v.size) >= 3000, 0.1234, 0.0)
    log = opened(v, t=t)
    np.testing.assert_array_equal(log.recording.v, V)
    assert "used what is between two gaps, from 6.123 to 10.923 s" in log.notes[0]


def test_of_a_log_that_goes_to_and_fro_the_longest_stretch_is_used():
    rest, ramp = np.zeros(150), np.linspace(0, -100, 200)
    v = np.concatenate([rest, V[:1100], rest, ramp, -V, ramp[::-1], rest, V[:1100]])
    v += np.random.default_rng(1).normal(0, 0.01, v.size)
    log = opened(v, t=2e-3 * np.arange(v.size))
    assert 0.9 * V.size < log.recording.v.size <= V.size
    assert abs(log.recording.v - 100).max() < 1.5
    assert any("turns backward" in note for note in log.notes)


def test_the_part_between_from_and_to_is_used():
    v = V.copy()
    v[3] = 1e9
    log = opened(v, replace(TURN, start_s=1.0, end_s=4.0), T + 7.0)
    np.testing.assert_array_equal(log.recording.v, V[500:2001])
    assert "no samples between --from and --to; the log lasts 4.8 s" in refusal(
        frame(), replace(TURN, start_s=10.0)
    )
