"""What is done to a log's samples, which values no logger measured, and which logs have no stretch that can be used."""

import numpy as np
import pytest
from scipy.signal import lfilter

from backlash.torque.answer import refuse_averaged
from replication.records import Recording
from tests import logs
from tests.logs import T, V, read, refusal, refused_for

RNG = np.random.default_rng(3)
SINE = np.sin(2 * np.pi * T / 0.4)
TORQUE = 3 + 10 * SINE + RNG.normal(0, 0.3, T.size)
K = np.arange(T.size)
TURNS = np.cumsum(V) * 2e-3
BURSTS = K // 2 * 4e-3 + K % 2 * 1e-4


def frame(v=V, torque=TORQUE, t=None):
    """A log of speed and torque."""
    return logs.frame(v, t, torque=np.resize(torque, len(v if t is None else t)))


def changed(signal, at, to):
    made = signal.copy()
    made[at] = to
    return made


def held(signal, samples):
    return signal[K // samples * samples]


# Words of a refusal and the log, then also with what is given of it.
REFUSED = {
    f"row 500: the speed stands at {V[500]:.6g} in 40 samples one after another: frozen": frame(
        changed(V, slice(500, 540), V[500])
    ),
    "the torque stands at -999 in 50 samples one after another: frozen, or a stand-in": frame(
        torque=changed(TORQUE, slice(700, 750), -999.0)
    ),
    "row 300: 4 single samples of the torque stray, the first is 9e+04 beside": frame(
        torque=changed(TORQUE, [300, 900, 901, 1500], 9e4)
    ),
    "1 single samples of the speed stray, the first is 900": frame(changed(V, 500, 900.0)),
    "row 1: the speed is 0 at 1,200 places between rows that are not": frame(
        np.where(K % 2, 0.0, V)
    ),
    "the speed stands for 3 samples in the mean: 167 new values a second, 252 are needed": frame(
        held(V, 3), held(TORQUE, 3)
    ),
    "the torque stands for 4 samples in the mean: 125 new values a second": frame(
        torque=held(TORQUE, 4)
    ),
    "new values a second, at uneven instants": frame(
        torque=TORQUE[np.maximum.accumulate(np.where(RNG.random(T.size) < 0.3, K, 0))]
    ),
    "its rows stand only where speed [rps] changed": frame(V.round(1))[
        np.append(True, np.diff(V.round(1)) != 0)
    ],
    "speed [rps] (in 1,201 rows) and torque (in 1,200 rows) stand in 0 rows together": frame(
        np.where(K % 2, np.nan, V), np.where(K % 2, TORQUE, np.nan)
    ),
    "the torque is clipped at -6 in": frame(torque=np.clip(TORQUE, -6, 99)),
    "the speed is clipped at 100.2 in": frame(np.minimum(V, 100.2)),
    "the motor makes 0.67 turns in a load turn of 0.4 s": frame(V / 60),
    "run backward (0 s follow 4.8 s after the first; 1 such rows)": frame(t=np.append(T, T)),
    "repeats the one before with other values": frame(t=np.floor(250 * T) / 250),
    "sampled at 10 Hz by its time stamps; a ring of 21 Hz": frame(t=0.1 * K),
    "are the stamps in s? if not, give --time-unit; if they count samples, --rate": frame(
        t=T * 1e-6
    ),
    "samples a second: give --rate 500": frame(t=BURSTS),
    "too short: 0.01 s in 6 samples; 4 load turns are needed": frame(V[:6]),
    "too short: 2.5 load turns of 0.4 s at": frame(V[:500]),
    "too short: 0.0": frame(np.append(0.0, V[:9])),
    "not constant speed: the motor stands still": frame(V - 100.0),
    "not constant speed: it drifts": frame(V + 0.8 * (T - 2.4)),
    "not constant speed": frame(V[:1800] * np.repeat([1, 0.5, 1.5], 600)),
    "is it in rpm, rad/s": frame(60 * V),
    "never changes, it is 100 throughout": frame(0 * V + 100),
}
REFUSED_BY_OPTIONS = [
    (
        "starts anew every 7.3 turns",
        frame(TURNS % 7.3),
        {"position": "2", "unit": "turns", "speed": None},
    ),
    ("impact needs 120 Hz", frame(t=T * 5), {"ring_hz": 30.0}),
    ("no samples between --from and --to; the log lasts 4.8 s", frame(), {"start_s": 10.0}),
    (
        "not constant speed: the motor moves to and fro",
        logs.frame(100 * np.sin(3 * T) + 0.1 * V),
        {"torque": None},
    ),
    (
        "too short: a load turn of 0.01 s is 5.0 samples long",
        frame(),
        {"turn_period_s": None, "gear_ratio": 1.0},
    ),
    ("rps longest, not 100 rps, by gear ratio and turn", frame(60 * V), {"gear_ratio": 40.0}),
    ("rps longest, not 100 rps, commanded", frame(V / 60), {"commanded_speed_rps": 100.0}),
    (
        "rps longest, not 80 rps, by gear ratio and turn",
        frame(),
        {"gear_ratio": 32.0, "commanded_speed_rps": 100.0},
    ),
]


@pytest.mark.parametrize("words", REFUSED)
def test_what_was_not_measured_is_refused_for_what_it_is_and_with_its_place(words):
    assert words in refusal(REFUSED[words], torque="torque")


@pytest.mark.parametrize(("words", "log", "given"), REFUSED_BY_OPTIONS)
def test_what_contradicts_the_options_is_refused(words, log, given):
    assert words in refusal(log, **given)


# A coarse speed that stands where it turns.
SMOOTH = (V.mean() + SINE * (1 + 0.3 * np.sin(6 * T))).round(1)
# Signals that are coarse or filtered, or of impacts, and no defect.
SOUND = {
    "a coarse torque": frame(torque=TORQUE.round()),
    "a coarse sine": frame(torque=(5 * SINE).round()),
    "both rounded": frame(V.round(1), TORQUE.round(1)),
    "a smooth speed": frame(SMOOTH),
    "a value that was filled in": frame(changed(SMOOTH, 1000, SMOOTH[1000] + 0.001)),
    "a torque that is at its limit for six samples": frame(
        torque=changed(TORQUE, slice(700, 706), TORQUE.max())
    ),
    "a noisy speed with one far sample": frame(
        changed(V + RNG.normal(0, 3.6, T.size), 700, V.mean() + 32)
    ),
    "a speed of so many far samples that they are its noise": frame(
        V
        + RNG.normal(0, 3.4, T.size)
        + (-1.0) ** K * (31 * (K % 50 // 2 == 12) + 40 * (K % 800 == 424))
    ),
    "impacts that are sampled once": frame(torque=TORQUE + 25 * (K % 200 == 7)),
    "stamps half a period beside whole milliseconds": frame(t=(T + 5e-4).round(3)),
}


@pytest.mark.parametrize("kind", SOUND)
def test_what_is_coarse_smooth_or_has_impacts_is_read_as_it_is(kind):
    log = read(SOUND[kind], torque="torque")
    np.testing.assert_array_equal(log.torque, SOUND[kind]["torque"])
    assert not any("new values" in note for note in log.notes)


def test_a_motor_that_rests_is_not_frozen_and_defects_outside_the_used_turns_do_not_matter():
    rest = np.zeros(400)
    torque = np.concatenate([rest, np.full(300, 40.0), TORQUE, rest])
    v = np.concatenate([rest, np.linspace(0, V[0], 300), V, rest])
    log = frame(v, changed(torque, 100, 1e5))
    assert read(log, torque="torque").recording.t.size > 2150


def test_of_held_values_the_new_ones_are_used_where_they_come_often_enough():
    t = 2e-3 / 3 * np.arange(3 * V.size)
    log = read(frame(np.repeat(V, 3), np.repeat(TORQUE, 3), t), torque="torque")
    np.testing.assert_array_equal(log.signals, [V, TORQUE])
    words = "the speed stands for 3 samples in the mean: 500 new values a second, which were used"
    assert words in log.notes


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
    log = logs.frame(TURNS, 3 * T, "position", torque=mean_of(width))
    log = read(log, turn_period_s=1.2, unit="turns", torque="torque")
    np.testing.assert_array_equal(log.signals[-1], mean_of(width)[1:])
    with refused_for(words):
        refuse_averaged(log.recording, log.signals[-1])


@pytest.mark.parametrize(
    ("per_turn", "modulus", "given"),
    [
        (1, None, {"unit": "turns"}),
        (1, 3, {"unit": "turns"}),
        (2 * np.pi, 1, {"unit": "rad"}),
        (2**12, 2**4, {"unit": "counts", "counts_per_turn": 2.0**12}),
        (-(2**20), 1, {"counts_per_turn": 2.0**20}),
        (1000, 10, {"counts_per_turn": 1000}),
        (4000, 25, {"counts_per_turn": 4000}),
        # A fifth of a turn a sample: most of a round, which a commanded speed tells either way.
        (2**12, 1 / 4, {"counts_per_turn": 2.0**12, "commanded_speed_rps": 101.5}),
        (-(2**12), 1 / 4, {"counts_per_turn": 2.0**12, "commanded_speed_rps": 101.5}),
    ],
)
def test_a_position_that_starts_anew_is_unwrapped_and_differentiated(per_turn, modulus, given):
    position = per_turn * (TURNS % modulus if modulus else TURNS)
    log = read(logs.frame(position, name="position"), **given)
    np.testing.assert_allclose(log.recording.v, V[1:], atol=1e-4)
    assert log.recording.commanded_speed_rps == pytest.approx(V[1:].mean())
    note = f"starts anew every {modulus} motor turns: unwrapped"
    assert any(note in each for each in log.notes) == bool(modulus)


def test_a_fast_log_is_averaged_down_and_of_a_long_one_sixty_turns_are_used():
    k = np.arange(48000)
    log = logs.frame(100 + 0.1 * np.sin(9e-4 * k), 1e-4 * k)
    assert read(log).recording.t[1] == pytest.approx(1e-3)
    assert read(frame(np.tile(V[:-1], 8))).recording.t[-1] == pytest.approx(24.0)


@pytest.mark.parametrize("wave", [0.05, 0.4])
@pytest.mark.parametrize("given", [{"turn_period_s": None, "gear_ratio": 40.0}, {}])
def test_within_a_turn_the_speed_may_do_what_the_drive_lets_it(wave, given):
    """Of a soft drive under a heavy load, with a ramp at both ends: all turns, and no ramp."""
    v = 100 + 100 * wave * np.cos(2 * np.pi * T / 0.4)
    ramp = np.linspace(0, 1, 300) * v[0]
    noise = np.random.default_rng(1).normal(0, 0.02, v.size + 600)
    recording = read(frame(np.concatenate([ramp, v, ramp[::-1]]) + noise), **given).recording
    assert recording.turn_period_s == pytest.approx(0.4, rel=0.01)
    assert recording.t[-1] > 10 * 0.4
    assert v.min() - 1 < recording.v.min()


def test_a_torque_that_is_missing_for_some_rows_is_filled_and_that_is_noted():
    torque = 3 + SINE + 0.01 * V
    log = read(frame(torque=changed(torque, [700, 701, 1500], np.nan)), torque="torque")
    np.testing.assert_allclose(log.torque, torque, atol=0.02)
    assert "left out 3 rows without torque" in log.notes
