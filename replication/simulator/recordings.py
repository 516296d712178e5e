"""Records of the simulated joint's motor speed, in the form of the authors' records, and as an encoder reads it."""

from collections.abc import Sequence

from replication.arrays import FloatArray
from replication.records import Recording
from replication.simulator.parameters import JointParameters
from replication.simulator.simulate import encoder_speed_rps, simulate_many

# Divides the drive's period and the sampling; the error is then far below the five digits of the
# authors' records.
SIMULATION_STEP_S = 5e-5


def simulate_recordings(
    joint: JointParameters, deltas_rad: Sequence[float], sample_s: float = 2e-3, turns: int = 12
) -> list[Recording]:
    """Record the simulated joint's motor speed at each backlash.

    The authors' records are twelve turns at 2 ms.
    """
    duration_s = turns * joint.turn_period_s
    runs = simulate_many(
        joint, deltas_rad, duration_s=duration_s, sample_s=sample_s, step_s=SIMULATION_STEP_S
    )
    speed, turn = joint.commanded_speed_rps, joint.turn_period_s
    name = "simulated joint, {:g} rad"
    return [
        Recording(run.time_s, run.motor_speed_rps, speed, turn, name.format(run.delta_rad))
        for run in runs
    ]


def read_encoder(
    joint: JointParameters, t: FloatArray, position_rad: FloatArray, bits: int, source: str
) -> Recording:
    """Record of the speed that is differenced from an encoder's positions at even times.

    One sample shorter.
    """
    speed = encoder_speed_rps(position_rad, bits, t[1] - t[0])
    return Recording(t[:-1], speed, joint.commanded_speed_rps, joint.turn_period_s, source)
