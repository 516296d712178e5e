"""Values that no logger measured: told for what they are, or undone; coarse ones are left alone."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from backlash.reading.columns import LogOptions
from backlash.reading.prepare import open_log
from backlash.torque.answer import refuse_averaged
from replication.records import Recording
from tests import logs
from tests.logs import TURN, T, V, file, refusal, refused_for

RNG = np.random.default_rng(3)
TORQUE = 3 + 10 * np.sin(2 * np.pi * T / 0.4) + RNG.normal(0, 0.3, T.size)
WITH_TORQUE = replace(TURN, torque="torque")
K = np.arange(T.size)


def frame(v=V, torque=TORQUE, t=T) -> pd.DataFrame:
    return logs.frame(v, t, torque=torque)


def changed(signal, at, to):
    made = signal.copy()
    made[at] = to
    return made


REFUSED = {
    "a frozen speed": (
        frame(changed(V, slice(500, 540), V[500])),
        f"row 502: the speed stands at {V[500]:.6g} in 40 samples one after another: frozen",
    ),
    "a torque frozen for a turn": (
        frame(torque=changed(TORQUE, slice(700, 900), TORQUE[700])),
        "row 702: the torque stands at",
    ),
    "a stand-in for missing values": (
        frame(torque=changed(TORQUE, slice(700, 750), -999.0)),
        "the torque stands at -999 in 50 samples one after another: frozen, or a stand-in",
    ),
    "a stand-in in the speed": (
        frame(changed(V, slice(1200, 1220), 65535.0)),
        "the speed stands at 65535 in 20 samples",
    ),
    "wild samples of the torque": (
        frame(torque=changed(TORQUE, [300, 900, 901, 1500], 9e4)),
        "row 302: 4 single samples of the torque stray, the first is 9e+04 beside",
    ),
    "rows of zeros between": (
        frame(np.where(K % 2, 0.0, V)),
        "row 3: speed [rps] is 0 at 1,200 places between rows that are not",
    ),
    "held values": (
        frame(V[K // 3 * 3], TORQUE[K // 3 * 3]),
        "the speed stands for 3 samples in the mean: 167 new values a second, 252 are needed",
    ),
    "a held torque": (
        frame(torque=TORQUE[K // 4 * 4]),
        "the torque stands for 4 samples in the mean: 125 new values a second",
    ),
    "values that stand unevenly": (
        frame(torque=TORQUE[np.maximum.accumulate(np.where(RNG.random(T.size) < 0.3, K, 0))]),
        "new values a second, at uneven instants",
    ),
    "rows where the speed changed": (
        frame(V.round(1)).iloc[np.append(True, np.diff(V.round(1)) != 0)],
        "its rows stand only where speed [rps] changed",
    ),
    "signals that take turns": (
        frame(np.where(K % 2, np.nan, V), np.where(K % 2, TORQUE, np.nan)),
        "speed [rps] (in 1,201 rows) and torque (in 1,200 rows) never stand in one row",
    ),
    "an empty column": (frame(torque=np.nan), "'torque' is empty in all 2,401 rows"),
    "samples that are counted": (
        frame(t=K),
        "its stamps count the samples, one by one: give --rate",
    ),
    "a clipped torque": (frame(torque=np.clip(TORQUE, -99, 11)), "the torque is clipped at 11 in"),
    "one clipped below": (frame(torque=np.clip(TORQUE, -6, 99)), "the torque is clipped at -6 in"),
    "a motor slower than its load": (
        frame(V / 60),
        "the motor makes 0.67 turns in a load turn of 0.4 s",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_was_not_measured_is_named_with_its_place(kind, tmp_path):
    log, words = REFUSED[kind]
    assert words in refusal(file(tmp_path, log.to_csv(index=False)), WITH_TORQUE)


# A coarse speed that stands where it turns.
SMOOTH = (V.mean() + np.sin(2 * np.pi * T / 0.4) * (1 + 0.3 * np.sin(6 * T))).round(1)
# Signals that are coarse or filtered, or of impacts, and no defect.
SOUND = {
    "a coarse torque": frame(torque=TORQUE.round()),
    "a coarse sine": frame(torque=(5 * np.sin(2 * np.pi * T / 0.4)).round()),
    "both rounded": frame(V.round(1), TORQUE.round(1)),
    "whole rpm": frame(np.floor(60 * V) / 60),
    "turns that are the same": frame(np.concatenate([V[:1200], V[:1201]])),
    "lines between values, by which right answers stay right": frame(
        torque=np.interp(T, T[::3], TORQUE[::3])
    ),
    "a smooth speed": frame(SMOOTH),
    "a value that was filled in": frame(changed(SMOOTH, 1000, SMOOTH[1000] + 0.001)),
    "impacts that are sampled once": frame(torque=TORQUE + 25 * (K % 200 == 7)),
    "stamps half a period beside whole milliseconds": frame(t=(T + 5e-4).round(3)),
}


@pytest.mark.parametrize("kind", SOUND)
def test_what_is_coarse_smooth_or_has_impacts_is_read_as_it_is(kind):
    log = SOUND[kind]
    read = open_log(log, WITH_TORQUE)
    np.testing.assert_array_equal(read.torque, log["torque"])
    assert not any("new values" in note for note in read.notes)


@pytest.mark.parametrize("bits", [16, 18, 23])
def test_a_fine_position_that_gains_speed_from_rest_is_not_interpolated(bits):
    t = 2e-3 * np.arange(4000)
    turns = (
        np.cumsum(np.clip(80 * (t - 0.3) / 0.7, 0, 80) + 0.1 * np.sin(2 * np.pi * t / 0.8)) * 2e-3
    )
    counts = np.floor(turns * 2**bits) + RNG.integers(0, 2, t.size) * (t < 0.3)
    options = LogOptions(turn_period_s=0.8, counts_per_turn=2.0**bits)
    assert logs.opened(counts, options, t, "position").recording.t[-1] > 6


def test_a_motor_that_rests_is_not_frozen_and_defects_outside_the_used_turns_do_not_matter():
    rest = np.zeros(400)
    v = np.concatenate([rest, np.linspace(0, V[0], 300), V, rest])
    torque = np.concatenate([rest, np.full(300, 40.0), TORQUE, rest])
    torque[100] = 1e5
    log = open_log(frame(v, torque, 2e-3 * np.arange(v.size)), WITH_TORQUE)
    assert log.recording.t.size > 2150


def test_of_held_values_the_new_ones_are_used_where_they_come_often_enough():
    log = open_log(
        frame(np.repeat(V, 3), np.repeat(TORQUE, 3), 2e-3 / 3 * np.arange(3 * V.size)), WITH_TORQUE
    )
    np.testing.assert_array_equal(log.torque, TORQUE)
    np.testing.assert_array_equal(log.recording.v, V)
    assert (
        "the speed stands for 3 samples in the mean: 500 new values a second, which were used"
        in log.notes
    )


def test_a_position_that_starts_anew_within_a_turn_is_asked_about():
    log = logs.frame(np.cumsum(V) * 2e-3 % 7.3, name="position")
    assert "starts anew every 7.3 turns" in refusal(log, replace(TURN, unit="turns"))


@pytest.mark.parametrize("given", [99.0, 100.0, 101.5])
def test_a_commanded_speed_checks_and_changes_nothing(given):
    plain, checked = (
        open_log(frame(), replace(WITH_TORQUE, commanded_speed_rps=each)).recording
        for each in (None, given)
    )
    assert checked.commanded_speed_rps == plain.commanded_speed_rps
    np.testing.assert_array_equal(checked.v, plain.v)


GERMAN = "Zeit [ms];Drehzahl [1/min];Moment\n"


@pytest.mark.parametrize("mark", ".,")
def test_marks_that_may_be_of_thousands_are_asked_about_where_the_speed_is_too_small(
    mark, tmp_path
):
    rows = [f"{2 * k};{int(60 * v) // 1000}.{int(60 * v) % 1000:03d};1.5" for k, v in enumerate(V)]
    path = file(tmp_path, GERMAN + "\n".join(rows).replace(".", mark))
    options = LogOptions(gear_ratio=40.0, torque="Moment")
    assert f"6{mark}004 may be 6004, with a mark of thousands" in refusal(path, options)
    mixed = [f"{2 * k};6000;{'1.024' if k % 3 else '987'}" for k in range(2401)]
    sentence = refusal(file(tmp_path, GERMAN + "\n".join(mixed)), options)
    assert "Moment: '1.024' beside '987' is 1024 by its mark of thousands" in sentence


def mean_of(width: int) -> np.ndarray:
    padded = np.concatenate([TORQUE[:width], TORQUE])
    return np.convolve(padded, np.ones(width) / width)[width : width + T.size]


@pytest.mark.parametrize(
    ("torque", "words"),
    [
        (TORQUE, None),
        (mean_of(3), None),
        (mean_of(7), "a running mean over 14 ms"),
        (mean_of(13), "a running mean over 26 ms"),
        (lfilter([0.3], [1, -0.7], TORQUE), None),
        (TORQUE + 20 * (RNG.integers(5, 9, T.size) == K % 200), None),
    ],
)
def test_a_running_mean_is_refused_and_neither_a_short_one_nor_a_low_pass(torque, words):
    with refused_for(words):
        refuse_averaged(Recording(T, V, 100.0, 0.4, "log"), torque)


@pytest.mark.parametrize(("width", "words"), [(1, None), (4, "a running mean over")])
def test_beside_a_position_the_torque_is_kept_as_it_was_logged(width, words):
    """A mean of four samples at 167 Hz hides what the teeth do; that of two, between two positions, is ours."""
    form, torque = replace(WITH_TORQUE, unit="turns"), mean_of(width)
    log = logs.opened(np.cumsum(V) * 2e-3, form, 3 * T, "position", torque=torque)
    np.testing.assert_array_equal(log.signals[-1], torque[1:])
    with refused_for(words):
        refuse_averaged(replace(log.recording, turn_period_s=1.2), log.signals[-1])
