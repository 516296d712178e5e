"""No answer is decided by rounding: a log scaled by 1 + 1e-9 has the same one."""

import numpy as np
import pandas as pd
import pytest

import backlash
from backlash.fitting import METHODS, SELF
from studies.benches import draw_turns
from tests.fitting.test_torque import answered
from tests.logs import noisy, table
from tests.sensor.test_strokes import strokes
from tests.sensor.test_torque_logs import logged

DELTAS = (4e-4, 9e-4, 1.6e-3)
FEW, MANY = pytest.param(DELTAS[1:2]), pytest.param(DELTAS[::2], marks=pytest.mark.slow)
BY_SPEED = [
    pytest.param(method, marks=[pytest.mark.slow] if method == "paper" else [])
    for method in (*METHODS, SELF)
]


def movement(log: pd.DataFrame, **how) -> float:
    """Largest relative movement of backlash and interval, of columns time, speed and maybe torque."""
    nudge = np.where(log.columns.str.startswith("time"), 1, 1 + 1e-9)
    found = now, nudged = [backlash.estimate(each, **how) for each in (log, nudge * log)]
    assert now.verdict == nudged.verdict == "backlash"
    ends = [np.array((each.backlash_rad, *each.backlash_interval_rad)) for each in found]
    return float(np.abs(ends[1] / ends[0] - 1).max())


@pytest.mark.parametrize("deltas", [FEW, MANY])
@pytest.mark.parametrize("method", BY_SPEED)
def test_rounding_does_not_move_an_answer_by_the_speed(method, deltas):
    for delta in deltas:
        log = table(noisy(delta, 0.05, 3))
        assert movement(log, method=method, turn_period_s=0.4, repeats=2) < 0.01


# A log of strokes takes 3 s a fit.
@pytest.mark.parametrize(
    ("draw", "deltas"),
    [(logged, DELTAS[1:2]), pytest.param(strokes, DELTAS, marks=pytest.mark.slow)],
)
def test_rounding_does_not_move_an_answer_by_the_torque(draw, deltas):
    for delta in deltas:
        frame, known = draw(3, delta)
        assert movement(frame, **known) < 0.01


# The second, without backlash, has ends of nearly the same chi squared at delays on either side of the limit.
@pytest.mark.parametrize(("seed", "delta"), [((150, 2), 4.3e-4), ((20462, 1, 8), 0.0)])
def test_rounding_turns_no_verdict_by_the_torque(seed, delta):
    rng = np.random.default_rng(seed)
    log = draw_turns(rng, delta, rng.uniform(0, 0.5))
    inertia, gravity = np.exp(rng.standard_normal(2) * (0.1, 0.05))
    load = {"inertia_ratio": inertia * log.inertia_ratio}
    load["gravity_per_s2"] = gravity * log.gravity_per_s2
    now, nudged = (
        answered(log._replace(v=scale * log.v, torque=scale * log.torque), **load)
        for scale in (1, 1 + 1e-9)
    )
    assert now.verdict == nudged.verdict == ("backlash" if delta else "no backlash")
    assert nudged.backlash_rad == pytest.approx(now.backlash_rad, rel=0.01, abs=1e-6)
