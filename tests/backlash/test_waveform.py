"""A joint's own calibration, the paper's as an example, and the paper's index without either."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import backlash
from backlash import Reason
from backlash.calibration import fit_calibration, read_calibration
from backlash.waveform import match
from replication.joint import change, identified_joint, simulate
from tests.logs import noisy, table

KNOWN_RAD = [4e-4, 6e-4, 8e-4, 1e-3, 1.2e-3, 1.4e-3, 1.6e-3]
TURN = {"turn_period_s": 0.4}


@pytest.fixture(scope="module")
def own():
    records = [noisy(delta, seed=k) for k, delta in enumerate(KNOWN_RAD)]
    return backlash.calibrate([table(record) for record in records], KNOWN_RAD, **TURN)


@pytest.mark.parametrize(
    ("delta", "is_own", "condition"),
    [
        (5e-4, True, "stiffness and the drive"),
        (1.5e-3, True, "stiffness and the drive"),
        (9e-4, False, "not your joint"),
    ],
)
def test_a_calibration_covers_the_truth_and_says_what_it_holds_for(own, delta, is_own, condition):
    given = {"calibration": own} if is_own else {"method": "waveform"}
    found = backlash.estimate(table(noisy(delta, seed=50)), **given, **TURN)
    low, high = found.backlash_interval_rad
    assert low < delta < high
    assert high - low < 2e-4
    assert condition in " ".join(found.notes)


def test_a_low_pass_of_the_log_is_found_with_a_joint_s_own_calibration(own):
    record = noisy(9e-4, 0.03)
    pole = np.exp(-2e-3 / 2e-3)
    v = lfilter([1 - pole], [1, -pole], record.v - record.v[0]) + record.v[0]
    filtered = replace(record, v=v)
    plain, free = (match(filtered, own.bank, is_own).delta_rad for is_own in (False, True))
    assert abs(free - 9e-4) < 4e-5
    assert abs(free - 9e-4) < 0.5 * abs(plain - 9e-4)


def test_another_stiffness_shows_in_chi_squared(own):
    same = noisy(1e-3, 0.03)
    run = simulate(change(identified_joint(), {"K_s": 0.7}), 1e-3)
    softer = replace(same, v=run.v + same.v - noisy(1e-3, 0.0).v)
    other, least = (
        backlash.estimate(table(record), calibration=own, **TURN).chi_squared
        for record in (softer, same)
    )
    assert other > 3 * least


SILENT = replace(noisy(), v=100 + np.random.default_rng(4).uniform(-0.1, 0.1, noisy().v.size))


@pytest.mark.parametrize(
    ("record", "period", "reason"),
    [
        (noisy(2.1e-3), 0.4, Reason.EXTRAPOLATED),
        (replace(noisy(), t=1.1 * noisy().t), 0.44, Reason.OTHER_MOVEMENT),
        (SILENT, 0.4, Reason.NO_SIGNATURE),
    ],
)
def test_what_a_calibration_does_not_explain_has_no_answer(own, record, period, reason):
    found = backlash.estimate(table(record), calibration=own, turn_period_s=period)
    assert (found.verdict, found.reason) == ("cannot tell", reason.value)


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
        ({"delta_rad": None}, "not a calibration file"),
        ({"uncertainty_rad": float("nan")}, "not finite"),
        ({"turn_period_s": -1.0}, "above 0"),
        ({"delta_rad": [1, 2]}, "do not fit"),
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
