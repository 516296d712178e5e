"""A rival of the signature: the time in the gap times the relative speed of motor and load."""

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import savgol_filter

from backlash.fitting.waveform import mean_turn, periodic, samples_a_turn
from replication.arrays import FloatArray
from replication.recording import Recording
from replication.simulator.parameters import TURN, JointParameters

LATEST_IMPACT = 0.15  # of a turn after the separation; later the load swings


def find_gaps(
    turn_rps: FloatArray, joint: JointParameters, smoothing_s: float
) -> list[tuple[float, float]]:
    """Separation (gravity changes its sign) and impact (the sharpest bend) in both half turns [s]."""
    period = joint.turn_period_s
    step = period / turn_rps.size
    window = 2 * int(smoothing_s / step / 2 + 1e-9) + 1
    bend = np.abs(savgol_filter(turn_rps, window, 2, deriv=2, mode="wrap"))
    gaps = []
    for turned in (0.5, 1.0):  # the load's angle
        separation = (turned - joint.start_angle_rad / TURN) % 1.0 * period
        since = (step * np.arange(turn_rps.size) - separation) % period
        impact = separation + since[np.where(since < LATEST_IMPACT * period, bend, 0).argmax()]
        gaps.append((separation, float(impact)))
    return gaps


def crossing_rad(turn_rps: FloatArray, joint: JointParameters, gap_s: tuple[float, float]) -> float:
    """Half of the relative displacement of motor and load [rad] between the ends of a gap."""
    t = np.linspace(*gap_s, 401)
    motor = periodic(turn_rps)(t / joint.turn_period_s % 1.0) * TURN / joint.gear_ratio
    angle = joint.start_angle_rad + TURN * t / joint.turn_period_s
    gravity = joint.ratios["gravity_per_s2"] * np.sin(angle)
    load = motor[0] - cumulative_trapezoid(gravity, t, initial=0.0)
    return float(abs(np.trapezoid(motor - load, t)) / 2)


def time_in_gap(recording: Recording, joint: JointParameters, smoothing_s: float) -> float:
    """Backlash [rad] as the relative speed of motor and load over the time in the gap, the mean of a turn's two gaps.

    The record consists of whole turns that begin at the joint's start angle; of the joint,
    stiffness and drive are not used. Villwock and Pacas, IEEE Transactions on Industrial
    Electronics 56(2), 2009, measure at reversals; this is their integral on the paper's movement,
    where gravity opens the gap.
    """
    turn = mean_turn(recording, samples_a_turn(recording))
    gaps = find_gaps(turn, joint, smoothing_s)
    return float(np.mean([crossing_rad(turn, joint, gap) for gap in gaps]))
