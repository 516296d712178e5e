import numpy as np
import pytest

from replication.joint import identified_joint
from studies import claims


@pytest.mark.parametrize(
    ("law", "is_uniform"),
    [
        (lambda n: n, True),
        (lambda n: np.random.default_rng(4).normal(0, 0.05, n.size), False),
        (lambda n: n + 0.01, False),
        (lambda n: n + np.roll(n, 1), False),
    ],
    ids=["uniform", "normal", "mean", "lag one"],
)
def test_noise_of_another_law_is_noticed(law, is_uniform):
    rng = np.random.default_rng(3)
    noises = {(level, 1): law(rng.uniform(-0.1, 0.1, 2401)) for level in range(9)}
    assert claims.uniform_noise(claims.noise_tests(noises))[0] is is_uniform


@pytest.mark.parametrize(("A", "holds"), [(0.01, True), (0.2, False)])
def test_an_amplitude_in_noise_alone_is_held_against_a_share_of_the_smallest(A, holds):
    assert claims.no_backlash(np.full(100, A), 0.26)[0] is holds
    assert claims.no_backlash(np.full(10, 0.01), 0.26)[0] is None  # ten noises cannot tell


def test_the_teeth_meet_twice_a_turn_on_alternate_sides():
    phases = claims.impact_phases(identified_joint(), [9e-4])
    assert len(phases) == 22
    assert (phases["phase"] == "descent").sum() == 11
    assert claims.impacts_at_phase_start(phases)[0]
    assert not claims.impacts_at_phase_start(phases.assign(share_passed=-0.1))[0]
    assert not claims.impacts_at_phase_start(phases.assign(share_passed=0.3))[0]


def test_the_error_of_a_shorter_record_is_measured_against_its_own_fit_without_noise():
    errors = claims.noise_errors_by_turns(identified_joint(), [9e-4], [1e-9], [1, 2], 2)
    assert errors["turns"].tolist() == [1, 2]
    assert errors["rms_error_rps"].max() < 1e-4


def test_an_encoder_of_many_bits_gives_the_speed_and_one_of_few_its_steps():
    joint = identified_joint()
    fine, finer, coarse = (claims.encoder_record(joint, 9e-4, n, 0.3) for n in (30, 40, 12))
    assert fine.v.mean() == pytest.approx(100, abs=0.01)
    assert np.abs(finer.v - coarse.v).max() > 1e3 * np.abs(finer.v - fine.v).max()
    steps = coarse.v * 2**12 * 0.002
    np.testing.assert_allclose(steps, steps.round(), atol=1e-6)
