"""The paper's index of a joint, where there is no torque."""

import pytest

import backlash
from backlash import Reason
from tests.logs import frame, noisy

TURN = {"turn_period_s": 0.4}


def test_without_a_torque_the_answer_is_the_paper_s_index_never_a_backlash():
    estimate = backlash.estimate(frame(), **TURN)
    assert (estimate.verdict, estimate.reason) == ("cannot tell", Reason.NO_TORQUE.value)
    assert "log the torque" in estimate.explanation
    assert estimate.backlash_rad is None
    low, high = estimate.amplitude_interval_rps
    assert low < estimate.amplitude_rps < high
    larger = backlash.estimate(frame(noisy(1.5e-3).v), **TURN)
    assert larger.amplitude_rps > 1.2 * estimate.amplitude_rps


def test_a_parameter_that_is_misspelt_is_an_error():
    with pytest.raises(TypeError, match="no parameter 'gear_ration'; there are time, rate_hz"):
        backlash.estimate(frame(), gear_ration=40)


@pytest.mark.parametrize(
    ("log", "v", "why"), [(3, None, "one int is no log"), ([0, 1], [2], "of one length")]
)
def test_what_is_no_log_is_refused(log, v, why):
    with pytest.raises(backlash.Refusal, match=why):
        backlash.estimate(log, v, unit="rps", **TURN)


def test_a_turn_that_is_given_a_little_wrong_is_corrected_with_a_note():
    estimate = backlash.estimate(frame(), turn_period_s=0.4008)
    assert estimate.turn_period_s == pytest.approx(0.4, rel=5e-4)
    assert any("used that" in note for note in estimate.notes)
