import numpy as np
import pytest

from replication.records import add_noise
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings
from studies.accuracy import cramer_rao_sd, waveform_slopes
from studies.joint_match import PHASES, match_joint

JOINT = identified_joint()


def bound_of_turns(slopes, noise_sd, turns=11):
    """Bound of whole turns at 200 samples each."""
    return cramer_rao_sd(np.tile(slopes[:, :: PHASES // 200], turns), noise_sd)


def test_the_bound_of_a_sine_s_size_is_the_textbook_s():
    # var = 2 sigma^2 / n for the amplitude of a sine in n samples.
    sine = np.sin(2 * np.pi * np.arange(PHASES) / PHASES)[None, :]
    assert bound_of_turns(sine, 0.1) == pytest.approx(0.1 * np.sqrt(2 / 2200), rel=1e-9)


def test_the_bound_falls_with_the_root_of_turns_and_grows_with_the_noise():
    slopes = waveform_slopes(JOINT, 9e-4)
    once = bound_of_turns(slopes, 0.06)
    assert bound_of_turns(slopes, 0.12) == pytest.approx(2 * once)
    assert bound_of_turns(slopes, 0.06, turns=44) == pytest.approx(once / 2)


def test_an_unknown_start_widens_the_bound():
    slopes = waveform_slopes(JOINT, 9e-4)
    assert bound_of_turns(slopes, 0.06) > 1.5 * bound_of_turns(slopes[:1], 0.06)


@pytest.mark.slow
def test_the_matched_joint_scatters_as_the_bound_says():
    clean = simulate_recordings(JOINT, [9e-4])[0]
    errors = [
        match_joint(add_noise(clean, 0.15, np.random.default_rng(seed)), JOINT)["delta_rad"] - 9e-4
        for seed in range(20)
    ]
    bound = bound_of_turns(waveform_slopes(JOINT, 9e-4)[:1], 0.15 / np.sqrt(3))
    # 20 errors know their RMS to 16 %; three of these.
    assert 0.52 < np.sqrt(np.mean(np.square(errors))) / bound < 1.48
