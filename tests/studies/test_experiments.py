"""What is simulated for the claims: noises, impacts, turns, friction, encoders."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from replication import table2
from replication.files import ROOT
from replication.joint import identified_joint
from replication.records import add_noise, constant_speed
from replication.signature import TURN
from studies import claims, experiments
from workbook.judging import decide


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
    p = claims.measure_uniform_noise(experiments.noise_tests(noises.values()))["low"]
    assert decide("uniform_noise", p) is is_uniform


def test_the_teeth_meet_twice_a_turn_soon_after_the_load_is_over_the_top_or_at_the_bottom():
    passed = experiments.impact_phases(identified_joint(), [9e-4, 1e-3])["share_passed"]
    assert len(passed) == 2 * 22
    assert passed.between(0, 0.25).all()


def test_a_softer_joint_changes_the_peak_by_as_much_as_the_committed_claim_says():
    fifth_lower = {"K_s/J_l": 0.8}
    percent = experiments.peak_change_percent(identified_joint(), fifth_lower, 13e-4)
    assert percent == pytest.approx(16, abs=0.5)


def test_a_kept_error_by_noise_comes_again():
    kept = pd.read_csv(ROOT / "results" / "noise_by_turns.csv").iloc[326]
    made = experiments.measure_error(kept["delta_rad"], int(kept["turns"]), int(kept["noise"]))
    assert made == pytest.approx(kept.to_dict(), rel=1e-3)


def test_the_amplitude_in_a_noise_is_that_of_one_run_with_its_seed():
    noise = add_noise(constant_speed(), 0.1, np.random.default_rng(8))
    fit = table2.fit(noise, table2.NOTEBOOK, 8)
    found = experiments.amplitudes_without_backlash([8], 0.1)
    np.testing.assert_allclose(found, abs(fit.X.A), rtol=1e-9)


def test_friction_changes_the_mean_of_four_logs_against_none(monkeypatch):
    joint = identified_joint()

    def fit_logs(cases, seed):
        shares = np.array([bench.joint.load_coulomb / joint.G for bench, _ in cases])
        assert {delta for _, delta in cases} == {1e-3}
        return pd.DataFrame({"A_rps": 2 - 10 * shares + 0.1 * (np.arange(len(shares)) % 4)})

    monkeypatch.setattr(experiments, "fit_logs", fit_logs)
    study = experiments.friction_study(joint, [0.01, 0.05])
    assert study["friction"].tolist() == [0, 0.01, 0.05]
    np.testing.assert_allclose(study["A_rps"], [2.15, 2.05, 1.65])
    np.testing.assert_allclose(study["change_percent"], [0, -10 / 2.15, -50 / 2.15], atol=1e-9)


def test_bits_change_the_amplitude_against_a_fine_encoder_at_some_angles(monkeypatch):
    def read_encoder(joint, t, angle, step, source):
        return SimpleNamespace(amplitude_rps=angle + 1e3 * step)

    def simulate(joint, delta, duration):
        return SimpleNamespace(t=None, theta_m=delta)

    monkeypatch.setattr(experiments, "simulate", simulate)
    monkeypatch.setattr(experiments, "read_encoder", read_encoder)
    monkeypatch.setattr(experiments, "best_fit", lambda record: record)
    study = experiments.bits_study(identified_joint(), [3e-4, 5e-4], [12, 19], offsets=3)
    assert study["bits"].tolist() == 2 * [12, 12, 12, 19, 19, 19]
    assert study["delta_rad"].tolist() == [3e-4] * 6 + [5e-4] * 6
    angles = np.tile(np.random.default_rng(1).uniform(0, TURN, 3), 4)
    steps = 1e3 * TURN * (2.0 ** -study["bits"] - 2.0**-experiments.FINE_BITS)
    np.testing.assert_allclose(study["change_rps"], angles + steps)
