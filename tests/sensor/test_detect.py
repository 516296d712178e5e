from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from backlash.detection.pattern import (
    POWER,
    band_energy,
    detect_pattern,
    explained_share,
    find_pattern,
)
from backlash.detection.period import FALSE_ALARMS, own_period
from backlash.reading.columns import LogFormat
from backlash.reading.prepare import Log
from backlash.refusals import Refusal
from replication.records import Recording
from replication.signature import Timing, signature
from replication.standins import Spread, draw_bench, encoder_log
from tests.logs import clean, noisy, silent

T = clean().t
TRIALS = 100
MOST_ALARMS = int(binom.ppf(0.999, TRIALS, FALSE_ALARMS))


def filtered(poles, rng):
    return lfilter([1], np.poly(np.exp(2e-3 * np.array(poles))).real, rng.standard_normal(T.size))


def tone(hertz, rng):
    return 0.2 * np.sin(2 * np.pi * hertz * T + rng.uniform(0, 6)) + 0.05 * rng.standard_normal(
        T.size
    )


NOISES = {
    "uniform": lambda rng: rng.uniform(-0.2, 0.2, T.size),
    "heavy-tailed": lambda rng: 0.02 * np.clip(rng.standard_cauchy(T.size), -30, 30),
    "wandering": lambda rng: 0.01 * np.cumsum(rng.standard_normal(T.size)),
    "of a differentiated encoder": lambda rng: 0.1 * np.diff(rng.standard_normal(T.size + 1)),
    "of a resonance at 21 Hz": lambda rng: 0.02 * filtered([-15 + 134j, -15 - 134j], rng),
    "with mains hum": lambda rng: tone(50.0, rng),
    "with the motor's ripple, gear ratio 40": lambda rng: tone(100.0, rng),
    "with the motor's ripple, gear ratio 41": lambda rng: tone(102.5, rng),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(NOISES))
def test_noise_in_a_healthy_joint_passes_for_a_pattern_no_more_often_than_promised(name):
    """The healthy joint is simulated, with gravity's ripple once a turn."""
    healthy = clean(0.0)
    alarms = same_sign = periods = 0
    for seed in range(TRIALS):
        record = replace(healthy, v=healthy.v + NOISES[name](np.random.default_rng(seed)))
        presence = find_pattern(record, seed=seed + 1)
        alarms += presence.found
        same_sign += presence.has_same_sign
        periods += own_period(record) is not None
    assert alarms <= MOST_ALARMS
    if (
        name != "with mains hum"
    ):  # 20 periods of it in a turn are a pattern, with the same sign in both halves
        assert same_sign <= MOST_ALARMS
    assert periods <= MOST_ALARMS


@pytest.mark.parametrize("noise", [0.1, 0.5])
def test_a_signature_of_the_detectable_energy_is_found_as_often_as_promised(noise):
    unit = signature(
        T, np.array([1.0, 0.0125, 15.0, 134.0, 100.0, 0.2, 0.0125]), Timing(0.2, 0.4, 12)
    )
    energy = band_energy(unit[: 100 * (T.size // 100)].reshape(-1, 100)[2], silent())
    found = 0
    for seed in range(TRIALS):
        blank = silent(noise, seed)
        amplitude = np.sqrt(find_pattern(blank).detectable_rps2 / energy)
        record = replace(blank, v=blank.v + amplitude * unit)
        found += find_pattern(record, seed + 1).found
    assert found >= binom.ppf(0.001, TRIALS, POWER)


def test_four_turns_are_enough_for_a_clear_pattern_and_three_are_not():
    def cut(turns):
        samples = 200 * turns + 1
        record = noisy()
        return find_pattern(replace(record, t=record.t[:samples], v=record.v[:samples])).found

    assert cut(4)
    assert not cut(3)


@pytest.mark.parametrize("given", [0.05, 0.2, 0.3, 0.391, 0.408, 0.5, 0.8, 3.0])
@pytest.mark.parametrize("delta", [3e-4, 20e-4])
def test_the_records_own_period_is_found_from_a_wrong_one(given, delta):
    for record in (clean(delta), noisy(delta)):
        assert own_period(replace(record, turn_period_s=given)) == pytest.approx(0.4, rel=1e-3)


@pytest.mark.parametrize("delta", [2e-4, 9e-4, 20e-4])
def test_the_right_period_stands(delta):
    for record in (clean(delta), noisy(delta), noisy(delta, 0.3)):
        assert own_period(record) in (0.4, None)


def test_a_signature_explains_itself_and_not_another_pattern():
    record = noisy()
    presence = find_pattern(record)
    assert explained_share(record, clean().v, presence) == pytest.approx(1.0, abs=0.02)
    assert explained_share(record, np.zeros(record.t.size), presence) == pytest.approx(
        0.0, abs=1e-6
    )
    assert explained_share(record, -clean().v, presence) < 0


def test_a_turn_without_room_for_an_oscillation_is_told_apart():
    with pytest.raises(Refusal, match="no room for an oscillation"):
        find_pattern(replace(noisy(), turn_period_s=0.01))


def test_what_noise_hides_grows_with_the_noise():
    quiet, loud = (find_pattern(silent(noise)).detectable_rps2 for noise in (0.1, 0.2))
    assert loud == pytest.approx(4 * quiet, rel=1e-3)


@pytest.mark.parametrize("seed", [3, 11, 19])
def test_the_right_period_stands_where_friction_makes_even_harmonics(seed):
    rng = np.random.default_rng((2, seed))
    delta = float(rng.uniform(3e-4, 21e-4))
    log = encoder_log(
        draw_bench(rng, Spread(ratios=0.2, load_friction=0.05, ripple=0.04)), delta, rng
    )
    assert own_period(log) == 0.4
    assert own_period(replace(log, turn_period_s=0.41)) == pytest.approx(0.4, rel=2e-3)


def test_a_turn_stands_though_a_large_backlash_repeats_itself_after_two():
    bench = draw_bench(np.random.default_rng((77, 1)))
    assert own_period(encoder_log(bench, 8e-3, np.random.default_rng(1))) == 0.4


def test_a_period_that_is_trusted_is_not_looked_for():
    form = LogFormat(turn_period_s=0.5)
    log = Log(file="log", recording=replace(noisy(), turn_period_s=0.5), form=form)
    with pytest.raises(Refusal, match="wrong period"):
        detect_pattern(log, 1)
    trusted = detect_pattern(replace(log, form=replace(form, trust_period=True)), 1)
    assert (trusted.recording.turn_period_s, trusted.notes) == (0.5, ())


def test_the_motors_own_harmonics_are_no_pattern_of_the_load():
    t = 2e-3 * np.arange(6001)
    log = Recording(
        t, 45 + 0.3 * np.sin(2 * np.pi * 45 * t), 45.0, 1.0, "a motor's ripple at an odd harmonic"
    )
    log = replace(log, v=log.v + np.random.default_rng(1).normal(0, 0.05, t.size))
    assert not find_pattern(log).found


def test_skirts_of_lines_in_a_quiet_record_are_no_other_period():
    turns = np.floor(np.cumsum(clean().v) * 2e-3 * 2**19) / 2**19
    quiet = replace(clean(), t=T[1:], v=np.diff(turns) / 2e-3)
    assert own_period(quiet) == quiet.turn_period_s
    assert own_period(replace(quiet, turn_period_s=0.6)) == pytest.approx(0.4, rel=1e-3)
