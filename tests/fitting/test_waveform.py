from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash.calibration import default_calibration
from backlash.fitting.waveform import (
    WaveformBank,
    low_passed,
    make_bank,
    match,
    mean_turn,
    periodic,
)
from replication.records import Recording, add_noise, level_delta_rad
from replication.records import load_clean

PERIOD_S = 0.4


@pytest.fixture(scope="module")
def bank():
    return default_calibration("waveform").bank


def made(bank, delta_rad, shift_turns=0.0, dt=0.002, turns=12, noise=0.0, seed=1):
    """A record of the bank's own waveform."""
    t = dt * np.arange(round(turns * PERIOD_S / dt) + 1)
    v = 100 + bank.at(delta_rad)((t / PERIOD_S - shift_turns) % 1.0)
    return add_noise(Recording(t, v, 100.0, PERIOD_S, "made"), noise, np.random.default_rng(seed))


@settings(max_examples=25)
@given(
    delta=st.floats(1.5e-4, 2.4e-3),
    shift=st.floats(0, 1),
    dt=st.sampled_from([0.0005, 0.002, 0.0033, 0.0071]),
    turns=st.floats(1.2, 14),
)
def test_a_record_of_the_bank_itself_gives_its_backlash_and_phase_however_sampled(
    bank, delta, shift, dt, turns
):
    found = match(made(bank, delta, shift, dt, turns), bank)
    assert found.delta_rad == pytest.approx(delta, abs=1e-9)
    assert abs((found.shift_turns - shift + 0.5) % 1 - 0.5) < 1e-6


@pytest.mark.slow
def test_the_interval_of_white_noise_holds_the_truth_about_19_times_in_20(bank):
    held = 0
    for seed in range(100):
        found = match(made(bank, 1.05e-3, 0.3, dt=0.004, turns=4, noise=0.15, seed=seed + 1), bank)
        held += found.interval_rad[0] <= 1.05e-3 <= found.interval_rad[1]
    assert 87 <= held <= 99  # binomial with p = 0.95: outside once in 150


def test_a_backlash_beyond_the_bank_ends_at_its_last_one(bank):
    small = WaveformBank(bank.delta_rad[:10], bank.waveform_rps[:10])
    found = match(made(bank, 2e-3), small)
    assert found.at_end
    assert found.delta_rad == pytest.approx(1e-3)


def test_a_record_shorter_than_a_turn_is_refused(bank):
    with pytest.raises(ValueError, match=r"0\.50 turns at 200 samples"):
        match(made(bank, 1e-3, turns=0.5), bank)


def test_waveforms_that_start_anywhere_are_aligned_into_the_same_bank(bank):
    deltas = bank.delta_rad[4:12]
    turns = [mean_turn(made(bank, delta, 0.1 * k), 200) for k, delta in enumerate(deltas)]
    assert np.mean(turns, axis=1) == pytest.approx(0, abs=1e-12)
    aligned = make_bank(deltas[::-1], turns[::-1])
    assert (aligned.delta_rad == deltas).all()
    for delta in (6.5e-4, 9.5e-4):
        assert match(made(bank, delta, 0.7), aligned).delta_rad == pytest.approx(delta, abs=2e-6)


def test_noisy_waveforms_are_averaged_over_the_levels_and_not_interpolated(bank):
    deltas = np.arange(3e-4, 22e-4, 1e-4)
    turns = [
        mean_turn(made(bank, delta, noise=0.15, seed=k + 1), 200) for k, delta in enumerate(deltas)
    ]
    noisy = make_bank(deltas, turns)
    for delta in (6.5e-4, 10.5e-4, 14.5e-4):
        assert match(made(bank, delta, 0.2), noisy).delta_rad == pytest.approx(delta, abs=3e-5)


@pytest.mark.parametrize("level", [3, 5, 8, 11, 13])
def test_the_simulated_bank_reads_the_authors_clean_records_within_three_microradians(
    authors_data, bank, level
):
    # The identified joint leaves about 1 % of the signal: a few 1e-6 rad.
    assert match(load_clean(level), bank).delta_rad == pytest.approx(
        level_delta_rad(level), abs=3e-6
    )


@pytest.mark.parametrize("edge_hz", [40, 60])
def test_a_low_pass_that_the_bank_does_not_have_is_found(bank, edge_hz):
    record = made(bank, 9e-4, noise=0.1)
    seconds = 1 / (2 * np.pi * edge_hz)
    whole, phases = bank.at(9e-4), record.t / PERIOD_S % 1
    turn = periodic(low_passed(whole(np.arange(800) / 800), (seconds / PERIOD_S) ** 2))
    filtered = replace(record, v=record.v + turn(phases) - whole(phases))
    found = match(filtered, bank, low_pass=True)
    assert found.low_pass_s == pytest.approx(seconds, rel=0.1)
    assert found.interval_rad[0] <= 9e-4 <= found.interval_rad[1]
    assert match(record, bank, low_pass=True).low_pass_s == 0
