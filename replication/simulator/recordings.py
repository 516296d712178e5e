"""Records of the simulated joint's motor speed, in the form of the authors' records."""

from collections.abc import Sequence

from replication.datasets import Recording
from replication.simulator.simulate import JointParameters, simulate_many

# Divides the drive's period and the sampling; the error is then far below the five digits of the authors' records.
SIMULATION_STEP_S = 5e-5


def simulate_recordings(
    joint: JointParameters, deltas_rad: Sequence[float], sample_s: float = 2e-3, turns: int = 12
) -> list[Recording]:
    """Record the simulated joint's motor speed at each backlash.

    Parameters
    ----------
    joint : JointParameters
        The joint.
    deltas_rad : sequence of float
        Backlash of each record [rad].
    sample_s : float
        Sampling period [s]; the authors' records have 2 ms.
    turns : int
        Length of the records in load turns; the authors' have twelve.

    Returns
    -------
    list of Recording
    """
    runs = simulate_many(
        joint, deltas_rad, duration_s=turns * joint.turn_period_s, sample_s=sample_s, step_s=SIMULATION_STEP_S
    )
    return [
        Recording(
            run.time_s,
            run.motor_speed_rps,
            joint.commanded_speed_rps,
            joint.turn_period_s,
            f"simulated joint, {run.delta_rad:g} rad",
        )
        for run in runs
    ]
