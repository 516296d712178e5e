"""The backlash by the motor's torque: a joint's drive need not be known."""

from dataclasses import replace

import numpy as np
import pytest

from backlash.fitting.torque import LoadData, fit_torque
from replication.standins import Bench, draw_bench
from studies.odd_joints import draw_cascade, log_with_torque, move_bench

DELTA = 9e-4


def load_data(bench: Bench, **others: float) -> LoadData:
    ratios = bench.joint.ratios
    return LoadData(
        **({name: ratios[name] for name in ("inertia_ratio", "gravity_per_s2")} | others)
    )


def draw(kind: str, number: int) -> Bench:
    rng = np.random.default_rng((11, number))
    return (
        move_bench(draw_bench(rng), 60.0, 0.8)
        if kind == "paper's"
        else move_bench(draw_cascade(rng), 60.0, 0.8)
    )


def fitted(bench: Bench, delta: float = DELTA, load: LoadData | None = None, **log: float):
    recording, torque = log_with_torque(bench, delta, np.random.default_rng(1), **log)
    return fit_torque(recording, torque, load or load_data(bench), np.random.default_rng(2))


@pytest.mark.parametrize("kind", ["paper's", "cascade"])
def test_without_noise_the_backlash_is_right_under_either_drive(kind):
    for number in range(3):
        bench = replace(draw(kind, number), noise_rps=1e-4)
        found = fitted(
            bench, torque_noise=1e-4, load=load_data(bench, inertia_sd=0.0, gravity_sd=0.0)
        )
        assert found.delta_rad == pytest.approx(DELTA, rel=0.05)
        assert found.motor_inertia == pytest.approx(bench.joint.motor_inertia_kgm2, rel=0.01)
        assert not found.refusal_reason


def test_the_unit_of_the_torque_and_a_lag_of_the_speed_do_not_matter():
    bench = draw("paper's", 4)
    recording, torque = log_with_torque(bench, DELTA, np.random.default_rng(1))
    load = load_data(bench)
    plain, scaled = (
        fit_torque(recording, unit * torque, load, np.random.default_rng(2)) for unit in (1.0, 37.0)
    )
    assert scaled.delta_rad == pytest.approx(plain.delta_rad)
    assert scaled.motor_inertia == pytest.approx(37 * plain.motor_inertia)
    late = replace(recording, t=recording.t[:-1], v=recording.v[:-1])
    lagging = fit_torque(late, torque[1:], load, np.random.default_rng(2))
    assert lagging.delta_rad == pytest.approx(plain.delta_rad, abs=0.5 * plain.sd_rad)


def test_what_is_not_known_of_the_load_widens_the_interval():
    bench = draw("paper's", 5)
    known, guessed = (
        fitted(bench, load=load_data(bench, inertia_sd=sd, gravity_sd=sd / 2)) for sd in (0.0, 0.2)
    )
    assert guessed.delta_rad == known.delta_rad
    assert guessed.sd_rad > 1.5 * known.sd_rad


def test_gravity_that_is_off_is_held_by_its_stated_uncertainty():
    bench = draw("paper's", 6)
    off = 1.1 * bench.joint.ratios["gravity_per_s2"]
    trusted, doubted = (
        fitted(bench, load=load_data(bench, gravity_per_s2=off, gravity_sd=sd)) for sd in (0.0, 0.1)
    )
    assert trusted.delta_rad > 1.05 * DELTA
    assert doubted.interval_rad[0] < DELTA < doubted.interval_rad[1]


def test_a_healthy_joint_and_a_faint_backlash_are_no_answer():
    for kind in ("paper's", "cascade"):
        assert "SD" in fitted(draw(kind, 7), 0.0).refusal_reason
    loud = replace(draw("cascade", 7), noise_rps=3.0)
    assert "SD" in fitted(loud, 2e-4).refusal_reason


def test_a_torque_that_is_none_is_refused_in_one_line():
    bench = draw("paper's", 8)
    recording, torque = log_with_torque(bench, DELTA, np.random.default_rng(1))
    bad = {
        "numbers": torque[:-1],
        "vary": np.ones_like(torque),
        "finite": np.where(torque > 0, torque, np.nan),
    }
    bad |= {"sign": -torque, "gravity": np.random.default_rng(3).normal(1, 0.1, torque.size)}
    for said, each in bad.items():
        with pytest.raises(ValueError, match=said) as error:
            fit_torque(recording, each, load_data(bench), np.random.default_rng(2))
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "wrong",
    [
        {"inertia_ratio": 0.0},
        {"gravity_per_s2": np.nan},
        {"inertia_sd": -0.1},
        {"gravity_sd": 10.0},
    ],
)
def test_load_data_that_no_load_has_are_refused(wrong):
    with pytest.raises(ValueError, match="above 0"):
        LoadData(**({"inertia_ratio": 4.0, "gravity_per_s2": 30.0} | wrong))


@pytest.mark.slow
def test_intervals_hold_the_truth_with_inputs_as_wrong_as_is_said():
    held = []
    for kind in ("paper's", "cascade"):
        for number in range(20, 30):
            bench, rng = draw(kind, number), np.random.default_rng((12, number))
            off = np.exp(rng.standard_normal(2) * (0.1, 0.05))
            given = [
                bench.joint.ratios[name] * f
                for name, f in zip(("inertia_ratio", "gravity_per_s2"), off, strict=True)
            ]
            found = fitted(bench, load=LoadData(*given))
            if not found.refusal_reason:
                held.append(found.interval_rad[0] <= DELTA <= found.interval_rad[1])
    assert len(held) >= 15
    assert np.mean(held) >= 0.85
