import numpy as np
import pandas as pd
import pytest

from replication import published
from replication.files import ROOT
from replication.joint import identified_joint
from studies import claims

RESULTS = ROOT / "results"


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
    p, _ = claims.measure_uniform_noise(claims.noise_tests(noises))
    assert published.decide("uniform_noise", p) is is_uniform


@pytest.mark.parametrize(("A", "holds"), [(0.01, True), (0.2, False)])
def test_an_amplitude_in_noise_alone_is_held_against_a_share_of_the_smallest(A, holds):
    percentile, _ = claims.measure_no_backlash(np.full(100, A), 0.26)
    assert published.decide("no_backlash", percentile) is holds
    of_ten, _ = claims.measure_no_backlash(np.full(10, 0.01), 0.26)
    assert published.decide("no_backlash", of_ten) is None  # ten noises cannot tell


def test_the_teeth_meet_twice_a_turn_on_alternate_sides():
    phases = claims.impact_phases(identified_joint(), [9e-4])
    assert len(phases) == 22
    assert (phases["phase"] == "descent").sum() == 11
    for passed, expected in ((phases["share_passed"], True), (-0.1, False), (0.3, False)):
        share, _ = claims.measure_impacts(phases.assign(share_passed=passed))
        assert published.decide("impacts_at_phase_start", share) is expected


def test_the_error_of_a_shorter_record_is_measured_against_its_own_fit_without_noise():
    errors = claims.noise_errors_by_turns(identified_joint(), [9e-4], [1e-9], [1, 2])
    assert errors["turns"].tolist() == [1, 1, 12, 12]
    assert errors["error_rps"].abs().max() < 1e-4


@pytest.mark.parametrize(("ratio", "holds"), [(0.5, True), (0.99, None), (2.0, False)])
def test_turns_reduce_the_error_if_the_ratio_of_errors_lies_surely_below_one(ratio, holds):
    rows = [(9e-4, turns, k, error) for turns, error in ((1, 1.0), (12, ratio)) for k in range(160)]
    errors = pd.DataFrame(rows, columns=["delta_rad", "turns", "noise", "error_rps"])
    interval, words = claims.measure_turns(errors)
    assert published.decide("turns_reduce_noise", interval) is holds
    assert "160 noises" in words


KEPT = pd.read_csv(RESULTS / "noise_by_turns.csv")


def test_a_kept_error_by_noise_comes_again():
    kept = KEPT[KEPT["noise"] == 7]
    again = claims.kept_noise_errors([7])
    np.testing.assert_allclose(again["error_rps"], kept["error_rps"], rtol=1e-3, atol=1e-6)


def test_the_kept_errors_are_of_160_noises_each():
    assert (KEPT.groupby(["delta_rad", "turns"])["noise"].nunique() == claims.NOISES).all()


@pytest.mark.parametrize(
    ("claim", "inside", "outside"),
    [
        ("uniform_noise", 0.5, 0.001),
        ("no_backlash", (0.1, 0.2), (0.3, 0.4)),
        ("little_tuning", (0.6, 0.7), (0.1, 0.2)),
        ("cma_beats_swarms", (0.01, 0.9), (0.9, 0.01)),
        ("code_and_data_public", 1, 0),
    ],
)
def test_a_margin_lies_below_one_where_a_sentence_holds_and_above_where_it_does_not(
    claim, inside, outside
):
    assert published.decide(claim, inside) is True
    assert published.decide(claim, outside) is False
    assert claims.margin(claim, inside)[1] <= 1 <= claims.margin(claim, outside)[0]


def test_an_encoder_of_many_bits_gives_the_speed_and_one_of_few_its_steps():
    joint = identified_joint()
    fine, finer, coarse = (claims.encoder_record(joint, 9e-4, n, 0.3) for n in (30, 40, 12))
    assert fine.v.mean() == pytest.approx(100, abs=0.01)
    assert np.abs(finer.v - coarse.v).max() > 1e3 * np.abs(finer.v - fine.v).max()
    steps = coarse.v * 2**12 * 0.002
    np.testing.assert_allclose(steps, steps.round(), atol=1e-6)
