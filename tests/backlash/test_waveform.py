"""A joint's own calibration, the paper's as an example, and the paper's index without either."""

import json
from dataclasses import replace

import numpy as np
import pytest

import backlash
from backlash import Reason
from backlash.calibration import example_calibration, fit_calibration, read_calibration
from backlash.waveform import match
from replication.joint import change, identified_joint, simulate
from replication.records import Recording
from tests.logs import clean, noisy, table

KNOWN_RAD = [4e-4, 6e-4, 8e-4, 1e-3, 1.2e-3, 1.4e-3, 1.6e-3]
TURN = {"turn_period_s": 0.4}


@pytest.fixture(scope="module")
def own():
    records = [noisy(delta, seed=k) for k, delta in enumerate(KNOWN_RAD)]
    return backlash.calibrate([table(record) for record in records], KNOWN_RAD, **TURN)


@pytest.mark.parametrize("delta", [5e-4, 9e-4, 1.5e-3])
def test_a_calibration_covers_the_truth_and_says_what_it_holds_for(own, delta):
    found = backlash.estimate(table(noisy(delta, seed=50)), calibration=own, **TURN)
    low, high = found.backlash_interval_rad
    assert low < delta < high
    assert high - low < 2e-4
    assert any("stiffness and the drive" in note for note in found.notes)


def test_the_paper_s_joint_is_an_example_and_said_to_be_one():
    found = backlash.estimate(table(noisy(9e-4)), method="waveform", **TURN)
    low, high = found.backlash_interval_rad
    assert low < 9e-4 < high
    assert "not your joint" in found.calibration


def test_a_low_pass_of_the_log_is_found_with_a_joint_s_own_calibration(own):
    record = noisy(9e-4, 0.03)
    pole = np.exp(-2e-3 / 2e-3)
    v = np.empty_like(record.v)
    v[0] = record.v[0]
    for k in range(1, v.size):
        v[k] = pole * v[k - 1] + (1 - pole) * record.v[k]
    filtered = replace(record, v=v)
    plain, free = (match(filtered, own.bank, is_own).delta_rad for is_own in (False, True))
    assert abs(free - 9e-4) < 4e-5
    assert abs(free - 9e-4) < 0.5 * abs(plain - 9e-4)


def test_another_stiffness_shows_in_chi_squared(own):
    joint = change(identified_joint(), {"K_s": 0.7})
    run = simulate(joint, 1e-3)
    v = run.v + np.random.default_rng(1).uniform(-0.03, 0.03, run.v.size)
    record = Recording(run.t, v, 100.0, 0.4, "softer")
    other = backlash.estimate(table(record), calibration=own, **TURN)
    same = backlash.estimate(table(noisy(1e-3, 0.03)), calibration=own, **TURN)
    assert other.chi_squared > 3 * same.chi_squared


def test_outside_the_range_and_in_another_movement_there_is_no_answer(own):
    beyond = backlash.estimate(table(noisy(2.1e-3)), calibration=own, **TURN)
    assert beyond.reason == Reason.EXTRAPOLATED.value
    slow = replace(noisy(), t=1.1 * noisy().t)
    found = backlash.estimate(table(slow), calibration=own, turn_period_s=0.44)
    assert found.reason == Reason.OTHER_MOVEMENT.value


def test_noise_is_no_backlash_by_a_calibration(own):
    silent = replace(noisy(), v=100 + np.random.default_rng(4).uniform(-0.1, 0.1, noisy().v.size))
    assert backlash.estimate(table(silent), calibration=own, **TURN).verdict == "cannot tell"


def test_a_calibration_travels_through_its_file(own, tmp_path):
    path = tmp_path / "own.json"
    path.write_text(own.to_json(), "utf-8")
    again = read_calibration(path)
    assert match(noisy(), again.bank).delta_rad == pytest.approx(
        match(noisy(), own.bank).delta_rad, rel=1e-4
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"waveforms": {}}, "delta_rad"),
        ({"uncertainty_rad": float("nan")}, "not finite"),
        ({"turn_period_s": -1.0}, "above 0"),
        ({"waveforms": {"delta_rad": [1, 2], "waveform_rps": [[1], [2]]}}, "do not fit"),
    ],
)
def test_a_file_that_is_no_calibration_is_refused_in_one_line(own, tmp_path, change, words):
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(json.loads(own.to_json()) | change), "utf-8")
    with pytest.raises(backlash.Refusal, match=words) as caught:
        read_calibration(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("delta", "words"),
    [
        ([-1e-4, *KNOWN_RAD[1:]], "not negative"),
        ([0.4, *KNOWN_RAD[1:]], "in mrad"),
        (KNOWN_RAD[:1] * 7, "different backlashes"),
        (np.array(KNOWN_RAD)[[2, 0, 6, 1, 5, 3, 4]], "order|uncertainty"),
    ],
)
def test_known_backlashes_that_cannot_be_are_refused(delta, words):
    with pytest.raises(backlash.Refusal, match=words):
        fit_calibration([noisy(each) for each in KNOWN_RAD], delta)


def test_without_torque_and_calibration_the_answer_is_the_paper_s_index_never_a_backlash():
    found = backlash.estimate(table(noisy()), **TURN)
    assert (found.verdict, found.reason) == ("cannot tell", Reason.NO_TORQUE.value)
    assert "log the torque, or calibrate" in found.explanation
    assert found.backlash_rad is None
    low, high = found.amplitude_interval_rps
    assert low < found.amplitude_rps < high
    larger = backlash.estimate(table(noisy(1.5e-3)), **TURN)
    assert larger.amplitude_rps > 1.2 * found.amplitude_rps


def test_a_turn_that_is_given_a_little_wrong_is_corrected_with_a_note():
    found = backlash.estimate(table(noisy()), turn_period_s=0.4008)
    assert found.turn_period_s == pytest.approx(0.4, rel=5e-4)
    assert any("used that" in note for note in found.notes)


def test_the_example_is_made_of_the_identified_joint():
    assert match(clean(9e-4), example_calibration().bank).delta_rad == pytest.approx(9e-4, rel=0.01)
