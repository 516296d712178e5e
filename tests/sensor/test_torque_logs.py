import json

import numpy as np
import pandas as pd
import pytest

import backlash
from backlash.calibration import default_calibration
from backlash.fitting.torque import LoadData
from backlash.reading.columns import LogFormat
from backlash.reading.prepare import open_log
from backlash.refusals import Refusal
from replication.simulator.parameters import GRAVITY
from studies.odd_joints import log_with_torque
from tests.cascades import draw_cascade
from tests.logs import command, table

DELTA = 1e-3


def logged(number: int, delta: float = DELTA, sample_s: float = 2e-3):
    """A table of a joint under a cascade, and what is known of its load."""
    bench = draw_cascade(np.random.default_rng((11, number)))
    recording, torque = log_with_torque(bench, delta, np.random.default_rng(1), sample_s)
    frame = table(recording).assign(**{"torque [Nm]": torque})
    ratios = bench.joint.ratios
    known = {
        "turn_period_s": recording.turn_period_s,
        "commanded_speed_rps": recording.commanded_speed_rps,
        "torque": "torque [Nm]",
    }
    return frame, known | {name: ratios[name] for name in ("inertia_ratio", "gravity_per_s2")}


@pytest.fixture(scope="module")
def joint():
    return logged(3)


OPTIONS = (
    "--turn-period {turn_period_s} --commanded-speed {commanded_speed_rps} "
    "--inertia-ratio {inertia_ratio} --gravity {gravity_per_s2} --json"
)


def test_a_file_a_table_and_arrays_have_one_answer_that_holds_the_truth(joint, tmp_path, capsys):
    frame, known = joint
    path = tmp_path / "log.csv"
    frame.to_csv(path, index=False)
    assert command("estimate", path, "--torque 3", OPTIONS.format(**known)) == 0
    from_file = json.loads(capsys.readouterr().out)[0]
    assert (from_file["method"], from_file["verdict"]) == ("torque", "backlash")
    low, high = from_file["backlash_interval_rad"]
    assert low < DELTA < high
    assert any(
        "inertia ratio of 0.6" in note and "(SD 10%)" in note for note in from_file["warnings"]
    )
    t, v, torque = frame.to_numpy().T
    arrays = known | {"torque": torque}
    movement, load = (
        {name: arrays[name] for name in names} for names in (list(known)[:3], list(known)[3:])
    )
    answers = [
        backlash.estimate(t, v, unit="rps", **arrays),
        backlash.estimate(frame, **known),
        backlash.estimate(backlash.read_log(t, v, **movement), **load),
    ]
    assert {answer.backlash_interval_rad for answer in answers} == {(low, high)}
    sure = backlash.estimate(frame, inertia_sd=0.0, gravity_sd=0.0, **known)
    assert np.ptp(sure.backlash_interval_rad) < 0.9 * (high - low)


def test_a_load_is_known_by_its_masses_or_by_its_ratios(joint):
    frame, known = joint
    gear = known["commanded_speed_rps"] * known["turn_period_s"]
    inertia = 1e-4 * known["inertia_ratio"] * gear**2
    masses = {
        "load_mass_kg": 20,
        "load_arm_m": known["gravity_per_s2"] * inertia / (20 * GRAVITY),
        "load_inertia_kgm2": inertia,
    }
    given = {"torque": "torque [Nm]", "gear_ratio": gear, "motor_inertia_kgm2": 1e-4}
    found = backlash.estimate(frame, **given, **masses)
    by_ratios = backlash.estimate(frame, **known)
    assert found.backlash_rad == pytest.approx(by_ratios.backlash_rad, rel=1e-3)
    assert any("the torque constant" in note for note in found.warnings)
    for changed, words in (
        ({"load_mass_kg": 1e4}, "about the joint's axis"),
        ({"load_arm_m": None}, "give --load-arm too"),
        ({"gravity_per_s2": 25.0}, "by its ratios or by its masses"),
    ):
        with pytest.raises(Refusal, match=words):
            backlash.estimate(frame, **(given | masses | changed))


def test_the_answer_goes_with_gravity_and_hardly_with_the_inertia_ratio(joint):
    frame, known = joint
    usual = backlash.estimate(frame, **known).backlash_rad
    for name, factor, expected in (
        ("gravity_per_s2", 1.2, 1.15),
        ("inertia_ratio", 0.7, 1.0),
        ("inertia_ratio", 1.3, 1.0),
    ):
        other = backlash.estimate(frame, **known | {name: factor * known[name]}).backlash_rad
        assert other / usual == pytest.approx(expected, abs=0.1)


def test_the_torque_goes_through_all_that_is_done_to_the_speed():
    """A torque that is a multiple of the speed still is one after cutting, filling, resampling and averaging."""
    rng = np.random.default_rng(1)
    for sample_s, jitter, backward in ((2e-3, 0.0, False), (2e-3, 0.3, True), (2e-4, 0.0, False)):
        k = np.arange(round(8 / sample_s))
        v = 100 + np.sin(9 * k * sample_s) + 0.01 * rng.standard_normal(k.size)
        v[: k.size // 10] = np.linspace(0, 100, k.size // 10)
        v *= -1 if backward else 1
        t = sample_s * (k + jitter * rng.uniform(-1, 1, k.size))
        frame = pd.DataFrame({"time": t, "speed": v, "torque": 7 * v}).drop(
            index=[k.size // 2, k.size // 3]
        )
        log = open_log(frame, LogFormat(turn_period_s=0.4, unit="rps", torque="torque"))
        assert log.recording.v.size < k.size
        np.testing.assert_allclose(log.torque, 7 * log.recording.v, rtol=1e-12)


def test_a_differentiated_position_has_the_torque_at_the_instants_of_its_speed():
    t = 2e-3 * np.arange(2000)
    position, torque = 100 * t - 0.1 * np.cos(60 * t) / 60, 5 * (100 + 0.1 * np.sin(60 * t))
    frame = pd.DataFrame({"time": t, "position [turns]": position, "torque": torque})
    log = open_log(frame, LogFormat(turn_period_s=0.4, torque="torque"))
    np.testing.assert_allclose(log.torque, 5 * log.recording.v, rtol=1e-6)


def test_a_dropped_sample_and_a_motor_that_turns_backward_change_little(joint):
    frame, known = joint
    whole = backlash.estimate(frame, **known)
    changed = frame.drop(index=500)
    changed[["speed [rps]", "torque [Nm]"]] *= -1
    found = backlash.estimate(changed, **known)
    assert "missing samples filled from their neighbours: 1" in found.warnings
    width = np.ptp(whole.backlash_interval_rad)
    assert found.backlash_rad == pytest.approx(whole.backlash_rad, abs=0.2 * width)


NO_LOAD = {"inertia_ratio": None, "gravity_per_s2": None}


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"inertia_ratio": None}, "give --inertia-ratio too"),
        (NO_LOAD, "give --inertia-ratio and --gravity too"),
        ({"torque": None}, "give --torque too"),
        (NO_LOAD | {"torque": None, "method": "torque"}, "give --torque and"),
        ({"torque": "moment"}, "no column 'moment'"),
        ({"torque": "holed"}, r"holed is missing or not a number \(NaN\)"),
        ({"torque": "speed [rps]", "speed": "speed [rps]"}, "cannot be both"),
        ({"method": "self"}, "leave out one of them"),
        ({"calibration": default_calibration("energy")}, "leave out one of them"),
        ({"gravity_per_s2": -1.0}, "must be above 0"),
    ],
)
def test_inputs_that_are_missing_or_wrong_are_named_in_one_line(joint, changed, words):
    frame, known = joint
    holed = frame["torque [Nm]"].where(frame.index != 700)
    with pytest.raises(Refusal, match=words) as error:
        backlash.estimate(frame.assign(holed=holed), **known | changed)
    assert "\n" not in str(error.value)


def test_a_torque_of_the_wrong_sign_is_no_answer_and_says_so(joint):
    frame, known = joint
    changed = frame.assign(**{"torque [Nm]": -frame["torque [Nm]"]})
    found = backlash.estimate(changed, **known)
    assert found.verdict == "cannot tell"
    assert "with its sign?" in found.warnings[0]


@pytest.mark.parametrize("number", [0, 1, 3])
def test_a_healthy_joint_has_no_backlash(number):
    frame, known = logged(number, 0.0)
    found = backlash.estimate(frame, **known)
    assert (found.verdict, found.method) == ("no backlash", "torque")


def test_a_trend_of_logs_with_torque_goes_through_the_truths(capsys, tmp_path):
    for month, delta in enumerate((8e-4, 1.2e-3, 1.6e-3), 1):
        frame, known = logged(3, delta)
        frame.to_csv(tmp_path / f"axis_2024-0{month}-01.csv", index=False)
    assert command("trend", tmp_path, "--torque 'torque [Nm]'", OPTIONS.format(**known)) == 0
    points = json.loads(capsys.readouterr().out)["points"]
    assert [point["backlash_rad"] for point in points] == pytest.approx(
        [8e-4, 1.2e-3, 1.6e-3], rel=0.1
    )


def test_a_load_inertia_a_little_below_that_of_a_point_is_a_measurement():
    masses = {"load_mass_kg": 5.0, "load_arm_m": 0.2, "motor_inertia_kgm2": 1e-4}
    load = LoadData.from_masses(40.0, load_inertia_kgm2=0.19, **masses)
    assert load.gravity_per_s2 == pytest.approx(9.81 / 0.2, rel=1e-3)
    assert "0.19 is below m r^2 = 0.2 kg m^2: that was taken" in str(load)
    with pytest.raises(Refusal, match=r"--load-inertia 0\.17: its mass at its arm alone"):
        LoadData.from_masses(40.0, load_inertia_kgm2=0.17, **masses)
