"""The backlash by the motor's torque: a joint's drive need not be known."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

import backlash
from backlash.fitting.torque import LoadData, fit_torque
from replication.standins import Bench, draw_bench
from studies.benches import BenchLog, Fault, draw_turns
from studies.odd_joints import log_with_torque, move_bench
from tests.cascades import draw_cascade

DELTA = 9e-4


def load_data(bench: Bench, **others: float) -> LoadData:
    known = {name: bench.joint.ratios[name] for name in ("inertia_ratio", "gravity_per_s2")}
    return LoadData(**known | others)


def draw(kind: str, number: int) -> Bench:
    rng = np.random.default_rng((11, number))
    bench = draw_bench(rng) if kind == "paper's" else draw_cascade(rng)
    return move_bench(bench, 60.0, 0.8)


def fitted(bench: Bench, delta: float = DELTA, load: LoadData | None = None, **log: float):
    recording, torque = log_with_torque(bench, delta, np.random.default_rng(1), **log)
    return fit_torque(recording, torque, load or load_data(bench))


@pytest.mark.parametrize("kind", ["paper's", "cascade"])
def test_without_noise_the_backlash_is_right_under_either_drive(kind):
    for number in range(3):
        bench = replace(draw(kind, number), noise_rps=1e-4)
        found = fitted(
            bench, torque_noise=1e-4, load=load_data(bench, inertia_sd=0.0, gravity_sd=0.0)
        )
        assert found.delta_rad == pytest.approx(DELTA, rel=0.05)
        assert found.motor_inertia == pytest.approx(bench.joint.motor_inertia_kgm2, rel=0.04)
        assert not found.refusal_reason


def test_the_unit_of_the_torque_and_a_lag_of_the_speed_do_not_matter():
    bench = draw("paper's", 4)
    recording, torque = log_with_torque(bench, DELTA, np.random.default_rng(1))
    load = load_data(bench)
    plain, scaled = (fit_torque(recording, unit * torque, load) for unit in (1.0, 37.0))
    assert scaled.delta_rad == pytest.approx(plain.delta_rad, rel=1e-4)
    assert scaled.motor_inertia == pytest.approx(37 * plain.motor_inertia, rel=1e-4)
    late = replace(recording, t=recording.t[:-1], v=recording.v[:-1])
    lagging = fit_torque(late, torque[1:], load)
    assert lagging.delta_rad == pytest.approx(plain.delta_rad, abs=0.5 * plain.sd_rad)


def test_what_is_not_known_of_the_load_is_found_by_the_log():
    bench = draw("paper's", 6)
    known, guessed = (
        fitted(bench, load=load_data(bench, inertia_sd=sd, gravity_sd=sd / 2)) for sd in (0.0, 0.2)
    )
    for found in (known, guessed):
        assert found.interval_rad[0] < DELTA < found.interval_rad[1]
    assert guessed.delta_rad == pytest.approx(known.delta_rad, abs=known.sd_rad)


def test_two_backlashes_that_fit_alike_are_no_answer_and_both_are_named():
    bench = draw("paper's", 5)
    found = fitted(bench, load=load_data(bench, inertia_sd=0.2, gravity_sd=0.1))
    assert "fits nearly as well as" in found.refusal_reason
    other = float(found.refusal_reason.split()[0])
    assert min(abs(each - DELTA) for each in (found.delta_rad, other)) < 0.1 * DELTA


def test_gravity_that_is_off_is_held_by_its_stated_uncertainty():
    bench = draw("paper's", 6)
    off = 1.1 * bench.joint.ratios["gravity_per_s2"]
    trusted, doubted = (
        fitted(bench, load=load_data(bench, gravity_per_s2=off, gravity_sd=sd)) for sd in (0.0, 0.1)
    )
    assert trusted.delta_rad > 1.05 * DELTA
    assert doubted.interval_rad[0] < DELTA < doubted.interval_rad[1]


@pytest.mark.parametrize(("kind", "number"), [("paper's", 7), ("cascade", 8)])
def test_a_healthy_joint_has_none_and_a_faint_backlash_is_no_answer(kind, number):
    healthy = fitted(draw(kind, number), 0.0)
    assert healthy.is_none or healthy.refusal_reason
    assert healthy.interval_rad[1] < 5e-5
    loud = fitted(replace(draw(kind, number), noise_rps=3.0), 1e-4)
    assert "SD" in loud.refusal_reason


def answered(log: BenchLog, **others: float):
    """The whole sensor's answer to a bench's log."""
    known = {"gear_ratio": log.gear_ratio, "inertia_ratio": log.inertia_ratio}
    known |= {"gravity_per_s2": log.gravity_per_s2} | others
    return backlash.estimate(log.t, log.v, torque=log.torque, unit="rps", **known)


def is_held(found: backlash.Estimate, delta: float) -> bool:
    return found.verdict == "backlash" and (
        found.backlash_interval_rad[0] < delta < found.backlash_interval_rad[1]
    )


def test_friction_of_the_load_hides_no_backlash():
    for number, delta in ((2, 4.3e-4), (3, 1e-3)):
        log = draw_turns(np.random.default_rng((150, number)), delta, 0.2)
        assert is_held(answered(log), delta)


def test_friction_above_gravity_is_no_answer():
    found = answered(draw_turns(np.random.default_rng((150, 4)), DELTA, 1.15))
    assert found.warnings[0].startswith("no load reversal seen")


def faulty(fault: Fault) -> BenchLog:
    return draw_turns(np.random.default_rng((246, 1)), DELTA, 0.05, fault)


GEAR = faulty(Fault()).gear_ratio
FAULTS = {
    "does another axis move": Fault(second_axis=0.2),
    "ms too late": Fault(late_torque_s=0.01),
    "error of the gear": Fault(transmission_rad=5e-4, transmission_order=3),
    "the gear's error part the teeth": Fault(transmission_rad=5e-4, transmission_order=2 * GEAR),
}


@pytest.mark.parametrize(("words", "fault"), FAULTS.items(), ids=FAULTS)
def test_what_the_model_lacks_is_refused_by_its_name(words, fault):
    found = answered(faulty(fault))
    assert found.verdict == "cannot tell"
    assert words in found.warnings[0]


def test_a_gear_s_error_that_parts_the_teeth_at_no_order_of_the_motor_is_no_absence():
    fault = Fault(transmission_rad=5e-4, transmission_order=100)
    log = draw_turns(np.random.default_rng((3131, 13)), 4e-4, 0.1, fault)
    assert log.gear_ratio % 100
    found = answered(log)
    assert found.verdict == "cannot tell"
    assert "the gear's error part the teeth" in found.warnings[0]


def test_a_gear_s_error_once_a_turn_does_not_matter():
    assert is_held(answered(faulty(Fault(transmission_rad=5e-4))), DELTA)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_gear_ratio_that_is_off_by_two_is_refused(factor):
    found = answered(faulty(Fault()), gear_ratio=factor * GEAR)
    assert found.warnings[0].startswith(("wrong period", "wrong torque"))


@pytest.mark.slow
def test_no_friction_of_the_load_makes_a_false_all_clear():
    """Joints with backlash are answered, most rightly; healthy ones are never called."""
    held = []
    for number in range(24):
        rng = np.random.default_rng((151, number))
        delta = 0.0 if number % 4 == 3 else np.exp(rng.uniform(np.log(2e-4), np.log(2.2e-3)))
        log = draw_turns(rng, delta, rng.uniform(0, 0.5))
        inertia, gravity = np.exp(rng.standard_normal(2) * (0.1, 0.05))
        load = {"inertia_ratio": inertia * log.inertia_ratio}
        found = answered(log, **load, gravity_per_s2=gravity * log.gravity_per_s2)
        assert found.verdict != ("backlash" if delta == 0 else "no backlash")
        if found.verdict == "backlash":
            held.append(is_held(found, delta))
    assert len(held) >= 14
    assert np.mean(held) >= 0.85


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
            fit_torque(recording, each, load_data(bench))
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
            with suppress(ValueError):  # refused
                found = fitted(bench, load=LoadData(*given))
                if not found.refusal_reason:
                    held.append(found.interval_rad[0] <= DELTA <= found.interval_rad[1])
    assert len(held) >= 15
    assert np.mean(held) >= 0.85
