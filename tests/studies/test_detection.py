import numpy as np
import pandas as pd
import pytest

from backlash.fitting.joint_match import match_joint
from backlash.studies.accuracy import (
    USUAL,
    bound_rad,
    detection_rates,
    matched_filter_delta_rad,
    measured_errors,
    noise_bound_rad,
    smallest_seen_rad,
    waveform_slopes,
)
from replication.datasets import add_uniform_noise
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import identified_joint

JOINT = identified_joint()


def sine_slopes(size=1.0):
    """One unknown that scales a sine: its bound is known by hand."""
    return size * np.sin(2 * np.pi * np.arange(800) / 800)[None, :]


def usual(**changed):
    """Settings of a log with the noise's SD in place of its half-amplitude."""
    half_amplitude = np.sqrt(3) * changed.pop("noise_sd", 0.06)
    return USUAL | {"noise_half_amplitude_rps": half_amplitude} | changed


def test_the_bound_of_a_sine_s_size_is_the_textbook_s():
    # var = 2 sigma^2 / n for the amplitude of a sine in n samples.
    bound = bound_rad(sine_slopes(), 0.4, usual(noise_sd=0.1, turns=11))
    assert bound == pytest.approx(0.1 * np.sqrt(2 / 2000), rel=1e-9)


def test_the_bound_falls_with_the_root_of_samples_and_turns_and_grows_with_the_noise():
    slopes = waveform_slopes(JOINT, 9e-4, True)
    bounds = [
        bound_rad(slopes, JOINT.turn_period_s, usual(**changed))
        for changed in ({}, {"noise_sd": 0.12}, {"turns": 45}, {"sampling_hz": 2000.0})
    ]
    assert bounds[1] == pytest.approx(2 * bounds[0])
    assert bounds[2] == pytest.approx(bounds[0] / 2)
    assert bounds[3] == pytest.approx(bounds[0] / 2, rel=0.02)


def test_an_encoder_s_bound_halves_with_each_bit_and_is_the_sine_s_in_position():
    bounds = [bound_rad(sine_slopes(), 0.4, usual(encoder_bits=bits, turns=11)) for bits in (10, 11)]
    assert bounds[0] == pytest.approx(2 * bounds[1])
    swing = 0.4 / (2 * np.pi)  # a speed of 1 rps swings the position by T / (2 pi) turns
    # An unknown slope over whole turns takes a little of a sine away.
    assert bounds[0] == pytest.approx(2.0**-10 / np.sqrt(12) / swing * np.sqrt(2 / 2000), rel=0.01)


def test_an_unknown_start_widens_the_bound():
    known, unknown = (bound_rad(waveform_slopes(JOINT, 9e-4, free), 0.4, usual()) for free in (False, True))
    assert unknown > 1.5 * known


@pytest.mark.slow
def test_the_matched_joint_scatters_as_the_bound_says():
    clean = simulate_recordings(JOINT, [9e-4])[0]
    errors = [
        match_joint(add_uniform_noise(clean, 0.15, np.random.default_rng(seed)), JOINT)["delta_rad"] - 9e-4
        for seed in range(20)
    ]
    bound = bound_rad(waveform_slopes(JOINT, 9e-4, False), 0.4, USUAL | {"noise_half_amplitude_rps": 0.15})
    # 20 errors know their RMS to 16 %; three of these.
    assert 0.52 < np.sqrt(np.mean(np.square(errors))) / bound < 1.48


def test_the_threshold_is_for_records_without_backlash_and_larger_backlash_is_seen_more_often():
    table = detection_rates(JOINT, [5e-5, 3e-4], 0.2, 0.1, healthy=30, repeats=6, seed=3)
    assert table["delta_rad"].tolist() == [0.0, 5e-5, 3e-4]
    assert table["seen"][0] < 0.3
    assert table["seen"][2] == 1.0
    assert ((table["seen_low"] <= table["seen"]) & (table["seen"] <= table["seen_high"])).all()


@pytest.mark.parametrize(
    ("seen", "expected"),
    [([0.0, 0.5, 1.0], 1.9), ([0.0, 1.0, 0.9, 1.0], 2.5), ([0.0, 0.5, 0.9], np.nan), ([0.0, 1.0, 1.0], 0.95)],
)
def test_the_smallest_seen_backlash_is_where_the_share_stays_above(seen, expected):
    table = pd.DataFrame({"delta_rad": np.arange(len(seen)), "seen": seen})
    assert smallest_seen_rad(table, 0.95) == pytest.approx(expected, nan_ok=True)


def test_a_matched_filter_sees_twice_the_backlash_at_most_in_half_the_noise():
    deltas = np.geomspace(1e-6, 1e-3, 25)
    quiet, loud = (matched_filter_delta_rad(JOINT, deltas, noise, 2200, 0.01, 0.95) for noise in (0.1, 0.2))
    assert 1e-6 < quiet < loud < 3e-4
    assert np.isnan(matched_filter_delta_rad(JOINT, deltas, 1e3, 2200, 0.01, 0.95))


@pytest.mark.slow
def test_measured_errors_stand_beside_the_bounds_of_the_same_settings():
    table = measured_errors(JOINT, [9e-4], {"turns": [4], "encoder_bits": [12]}, repeats=2, seed=1)
    assert set(table.loc[table["axis"] == "turns", "method"]) == {
        "amplitude", "energy", "waveform", "joint", "bound, start known", "bound, start free",
    }  # fmt: skip
    bound = table.set_index(["axis", "method"])["rmse_rad"]["turns", "bound, start known"]
    slopes = waveform_slopes(JOINT, 9e-4, False)
    assert bound == pytest.approx(bound_rad(slopes, JOINT.turn_period_s, USUAL | {"turns": 4}))


def test_the_bound_on_the_authors_noise_is_larger_with_a_free_start():
    bound = noise_bound_rad(JOINT, range(3, 12)).set_index("start")["mean_abs_error_rad"]
    assert 0 < bound["known"] < bound["free"] < 2e-5
