"""When samples were taken: units and kinds of stamps, their order, the even grid behind them, and what it lacks."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from backlash.reading.columns import LogFormat
from backlash.reading.prepare import open_log
from backlash.refusals import Refusal
from tests.logs import TURN, file, noisy, opened, refusal, text

T, V = noisy().t, noisy().v
EPOCH = 1_710_000_000
# Seconds as a file may have them, and the unit in which they are read.
STAMPS = {
    "milliseconds by name": ("time [ms]", 1e3 * T, "ms"),
    "100 ns by name": ("time [100 ns]", 1e7 * T, "100 ns"),
    "days by name": ("time [days]", T / 86400, "days"),
    **{
        f"{unit} since 1970": ("timestamp", EPOCH * per + np.rint(per * T).astype("int64"), unit)
        for unit, per in (("ms", 10**3), ("us", 10**6), ("ns", 10**9))
    },
    "a scope's, from before the trigger": ("time", T - 1.0, "s"),
    "dates of pandas": (
        "time",
        pd.Timestamp("2024-03-17 23:59:58") + pd.to_timedelta(T, unit="s"),
        "date-time",
    ),
    "durations": ("time", pd.to_timedelta(T, unit="s"), "date-time"),
}


@pytest.mark.parametrize("kind", STAMPS)
def test_stamps_of_every_unit_are_read_and_it_is_named(kind):
    name, stamps, unit = STAMPS[kind]
    log = open_log(pd.DataFrame({name: stamps, "speed [rps]": V}), TURN)
    np.testing.assert_allclose(log.recording.t, T, atol=2e-5)
    np.testing.assert_allclose(log.recording.v, V, atol=0.05)
    assert f"time {name!r} [{unit}]" in log.columns


@pytest.mark.parametrize(
    ("t", "why"),
    [
        (
            np.append(T, T),
            "start anew or run backward (0 s follow 4.8 s after the first; 1 such rows)",
        ),
        (T[::-1], "start anew or run backward"),
        (np.where(np.arange(T.size) == 500, 0.5, T), "run backward (0.5 s follow 0.998"),
        (np.floor(250 * T) / 250, "repeats the one before with other values"),
        (0.1 * np.arange(T.size), "sampled at 10 Hz; a ring of 21 Hz after an impact needs 84 Hz"),
    ],
)
@pytest.mark.parametrize("part", [{}, {"start_s": 0.5, "end_s": 4.0}])
def test_stamps_that_cannot_be_are_refused_for_what_they_are(t, why, part):
    log = pd.DataFrame({"time": t, "speed [rps]": np.resize(V, t.size)})
    assert why in refusal(log, replace(TURN, **part))


@pytest.mark.parametrize(
    ("name", "stamps", "unit"),
    [
        ("ticks since the year 1", 6.38e17 + np.rint(1e7 * T), "100ns"),
        ("days of a spreadsheet", 45_000 + T / 86400, "d"),
        ("time [ticks]", 1e3 * T, "ms"),
    ],
)
def test_a_unit_of_time_that_is_not_known_is_asked_for(name, stamps, unit):
    log = pd.DataFrame({name: stamps, "speed [rps]": V})
    assert re.search("--time-unit|there are s, ", refusal(log, replace(TURN, time=name)))
    read = open_log(log, replace(TURN, time=name, time_unit=unit)).recording
    np.testing.assert_allclose(read.t, T, atol=2e-5)


def test_samples_that_a_polling_logger_repeats_are_merged_and_that_is_noted():
    log = opened(np.repeat(T, 3), np.repeat(V, 3))
    np.testing.assert_allclose(log.recording.v, V)
    assert "merged 4802 rows with the time stamp of the next" in log.notes


@pytest.mark.parametrize("together", [2, 4, 8])
@pytest.mark.parametrize("rate", [100, 500])
def test_stamps_in_bursts_are_refused_with_the_rate_that_reads_them(together, rate):
    k = np.arange(12 * rate)
    t = k // together * together / rate + k % together * 1e-4
    v = np.interp(k / rate % 4.8, T, V)
    said = refusal(pd.DataFrame({"time": t, "speed [rps]": v}))
    given = float(said.partition("give --rate ")[2].partition(",")[0])
    assert given == pytest.approx(rate, rel=0.01)
    assert opened(t, v, replace(TURN, rate_hz=float(rate))).recording.t[-1] > 11


def test_lost_samples_are_filled_up_to_a_tenth():
    draw = np.random.default_rng(5).random(T.size)
    few, many = draw > 0.05, draw > 0.2
    assert opened(T[few], V[few]).recording.v.size == pytest.approx(T.size, abs=3)
    with pytest.raises(Refusal, match="would be invented"):
        opened(T[many], V[many])


@pytest.mark.parametrize("empty", ["", "0.9,"])
def test_rows_without_a_number_stay_holes_at_a_given_rate(empty, tmp_path):
    rows = text("a,speed [rps]").splitlines()
    rows[500:503] = [empty] * 3
    log = open_log(file(tmp_path, "\n".join(rows)), replace(TURN, rate_hz=500.0))
    np.testing.assert_allclose(log.recording.v[510:], V[510:], atol=1e-4)
    assert log.recording.v.size == V.size
    assert "missing samples filled from their neighbours: 3" in log.notes


def test_the_least_rate_is_that_of_the_joints_ring():
    t = np.arange(1200) / 100
    v = np.interp(t % 4.8, T, V)
    assert "below 252 Hz the peaks" in opened(t, v).notes[0]
    assert opened(t, v, replace(TURN, ring_hz=8.0)).notes == ()
    with pytest.raises(Refusal, match="a ring of 30 Hz after an impact needs 120 Hz"):
        opened(t, v, replace(TURN, ring_hz=30.0))


def without(places, t, v):
    return np.delete(t, places), np.delete(v, places)


@pytest.mark.parametrize("places", [[3], [5, 1200, 1300, 1301, 2390]])
def test_only_the_holes_of_dropped_samples_are_filled(places):
    log = opened(*without(places, T, V))
    kept = np.setdiff1d(np.arange(T.size), places)
    np.testing.assert_allclose(log.recording.t, T, atol=1e-9)
    np.testing.assert_allclose(log.recording.v[kept], V[kept], rtol=1e-12)
    assert abs(log.recording.v[places] - V[places]).max() < 0.5
    assert log.notes == (f"missing samples filled from their neighbours: {len(places)}",)


@pytest.mark.parametrize("rate", [667.0, 300.0, 600.0])
@pytest.mark.parametrize("places", [[], [10, 1500]])
def test_stamps_rounded_to_a_millisecond_are_put_back_on_their_grid(rate, places):
    t = np.arange(3200) / rate
    v = 100 + np.sin(5 * t) + np.random.default_rng(1).normal(0, 0.1, t.size)
    kept = np.delete(np.arange(t.size), places)
    log = opened(t[kept].round(3), v[kept])
    np.testing.assert_allclose(log.recording.t, t, atol=2e-6)
    np.testing.assert_allclose(log.recording.v[kept], v[kept], rtol=1e-12)
    assert any("taken as even" in note for note in log.notes)


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


def test_of_a_log_with_a_gap_the_side_where_the_motor_goes_farther_is_used():
    log = opened(*without(slice(1000, 1010), T, V))
    np.testing.assert_array_equal(log.recording.v, V[1010:])
    assert log.notes == (
        "used what is between two gaps, from 2.020 to 4.800 s after the log's first sample",
    )
    v = np.concatenate([np.zeros(3000), V])
    t = 2e-3 * np.arange(v.size) + np.where(np.arange(v.size) >= 3000, 0.1234, 0.0)
    np.testing.assert_array_equal(opened(t, v).recording.v, V)


@pytest.mark.parametrize("forward_is_longer", [True, False])
def test_of_a_log_that_goes_to_and_fro_the_longest_stretch_is_used(forward_is_longer):
    rest, ramp = np.zeros(150), np.linspace(0, 100, 200)
    short, long = V[:1100], V
    there, back = (long, short) if forward_is_longer else (short, long)
    cycle = [ramp, there, ramp[::-1], rest, -ramp, -back, -ramp[::-1], rest]
    v = np.concatenate([rest, *cycle, ramp, short, ramp[::-1]])
    v += np.random.default_rng(1).normal(0, 0.01, v.size)
    log = opened(2e-3 * np.arange(v.size), v)
    assert 0.9 * long.size < log.recording.v.size <= long.size
    assert abs(log.recording.v - 100).max() < 1.5
    assert sum("used the constant speed from" in note for note in log.notes) == 1
    assert any("turns backward" in note for note in log.notes) == (not forward_is_longer)


def test_the_part_between_from_and_to_is_used():
    v = V.copy()
    v[3] = 1e9
    log = opened(T + 7.0, v, replace(TURN, start_s=1.0, end_s=4.0))
    np.testing.assert_array_equal(log.recording.v, V[500:2001])
    assert log.recording.t[0] == 0.0
    assert log.notes == ("used 1501 of 2401 samples, by --from and --to",)
    with pytest.raises(Refusal, match=r"no samples between --from and --to; the log lasts 4.8 s"):
        opened(T, V, replace(TURN, start_s=10.0))


@pytest.mark.parametrize("hz", [200.0, 500.0, 2000.0])
@pytest.mark.parametrize("are_few", [True, False])
def test_stamps_that_are_late_by_most_of_a_period_are_numbered_one_by_one(hz, are_few):
    t = np.arange(0, 6, 1 / hz)
    lateness = np.random.default_rng(3).uniform(0, 0.8 / hz, t.size)
    if are_few:
        lateness[np.arange(t.size) % 10 > 0] = 0
    recording = opened(t + lateness, np.interp(t % 4.8, T, V)).recording
    assert recording.t[1] == pytest.approx(1 / hz, rel=1e-5)
    assert recording.t.size == t.size


def test_a_clock_that_drifts_is_followed_and_no_sample_is_made_beyond_the_last():
    """With late stamps, gaps of 8 ms and 1 % lost samples."""
    rng = np.random.default_rng(8)
    true = np.arange(20 * 490) / 490
    v = 1 + 0.01 * (np.interp(true % 4.8, T, V) - 100)
    v += rng.normal(0, 1e-4, true.size)
    stamps = true + 20 / 490 * np.sin(np.pi * true / 10) + rng.uniform(0, 2e-4, true.size)
    lost = rng.random(true.size) < 0.01
    for gap in (500, 1700, 2800):
        lost[gap : gap + 3] = True
    true, v = true[~lost], v[~lost]
    log = opened(stamps[~lost], v, LogFormat(turn_period_s=1.0))
    assert "resampled" in log.notes[0]
    assert v.min() - 0.002 < log.recording.v.min()
    assert log.recording.v.max() < v.max() + 0.002
    at = log.recording.t + true[0]
    assert np.abs(log.recording.v - np.interp(at, true, v)).std() < 2e-3
