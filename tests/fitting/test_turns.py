"""Slopes of a settled turn."""

import numpy as np
import pytest

from backlash.fitting.turns import COLUMNS, Movement, simulate_turns, turn_and_slopes
from replication.simulator.parameters import identified_joint

MOVEMENT = Movement(40.0, 0.4)
SETTLED = 1e-7
STEP = {
    "delta_rad": 1e-6, "friction": 1e-3, "error_sine_rad": 1e-6, "error_cosine_rad": 1e-6, "ripple_sine": 1e-3,
    "ripple_cosine": 1e-3,
}  # fmt: skip


def row(order: int, delta_rad: float) -> np.ndarray:
    values = dict.fromkeys(COLUMNS, 0.0) | {
        k: v for k, v in identified_joint().ratios.items() if k in COLUMNS
    }
    values |= {
        "delta_rad": delta_rad,
        "friction": 0.01,
        "ripple_sine": 0.01,
        "ripple_cosine": -0.005,
    }
    if order:
        values |= {"error_sine_rad": 1e-5, "error_cosine_rad": -2e-5}
    return np.array([values[name] for name in COLUMNS])


@pytest.mark.parametrize(
    ("order", "differencing", "delta_rad"), [(0, True, 1e-3), (9, True, 4e-4), (8, False, 2e-3)]
)
def test_slopes_are_those_of_differences_of_settled_turns(order, differencing, delta_rad):
    here = row(order, delta_rad)
    turn, _, slopes, _ = turn_and_slopes(here, MOVEMENT, order, differencing, SETTLED)
    assert turn == pytest.approx(
        simulate_turns(here[None], MOVEMENT, order, 8, differencing)[0], abs=2e-5
    )
    for k, name in enumerate(COLUMNS):
        if "error" in name and not order:
            continue
        step = STEP.get(name, 1e-3 * here[k])
        batch = np.repeat(here[None], 2, axis=0)
        batch[:, k] += [step, -step]
        up, down = simulate_turns(batch, MOVEMENT, order, 8, differencing)
        difference = (up - down) / (2 * step)
        # Where the teeth meet, a step moves the turn's corners by more than its slope tells: the difference errs there.
        assert np.std(slopes[k] - difference) < 0.02 * np.std(difference), name


def test_a_push_on_the_load_has_the_slope_of_its_difference():
    here = row(9, 1e-3)
    angle = 2 * np.pi * np.arange(MOVEMENT.periods) / MOVEMENT.periods
    omega = 2 * np.pi / MOVEMENT.turn_period_s
    # A transmission error shakes the load with its second derivative; what it does to gravity besides is small.
    push = -((9 * omega) ** 2) * np.sin(9 * angle)
    slopes = turn_and_slopes(here, MOVEMENT, 9, True, SETTLED, push[None]).slopes
    as_error = slopes[COLUMNS.index("error_sine_rad")]
    assert np.std(slopes[-1] - as_error) < 0.05 * np.std(as_error)


def test_a_joint_that_runs_away_has_no_turn_and_no_slopes():
    wild = row(0, 1e-3)
    wild[COLUMNS.index("integral_gain_per_s2")] *= 1e3
    assert np.isnan(simulate_turns(wild[None], MOVEMENT)).all()
    turn = turn_and_slopes(wild, MOVEMENT, 0, True, SETTLED)
    for part in (turn.motor_rps, turn.load_rad_per_s, turn.slopes):
        assert np.isnan(part).all()
