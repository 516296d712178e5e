"""The paper's experiments on the simulated joint: validation, growth of the disturbance, its amplitude."""

from collections.abc import Sequence

import pandas as pd

from replication import published
from replication.datasets import Recording, level_delta_rad
from replication.simulator.identification import FINE_S
from replication.simulator.simulate import JointParameters, settled_peak_rps, simulate_many


def printed_amplitudes() -> dict[float, float]:
    """Table 2's theoretical A [rps] by backlash [rad]."""
    theoretical = published.column("Table 2", "theoretical")
    return {level_delta_rad(level): theoretical[level - 2] for level in range(2, 2 + theoretical.size - 1)}


def amplitudes(joint: JointParameters, deltas_rad: Sequence[float]) -> pd.DataFrame:
    """Measure the theoretical A of the simulated joint: the settled peak before sampling at 2 ms."""
    fine = simulate_many(joint, deltas_rad, sample_s=FINE_S, step_s=FINE_S)
    coarse = simulate_many(joint, deltas_rad, step_s=FINE_S)
    rows = [
        (delta, settled_peak_rps(before, joint), settled_peak_rps(after, joint))
        for delta, before, after in zip(deltas_rad, fine, coarse, strict=True)
    ]
    return pd.DataFrame(rows, columns=["delta_rad", "amplitude_rps", "sampled_rps"])


def disturbances(recordings: Sequence[Recording], deltas_rad: Sequence[float]) -> pd.DataFrame:
    """Cut the third turn out of records: figure 11's signals."""
    parts = []
    for recording, delta in zip(recordings, deltas_rad, strict=True):
        begin, end = 2 * recording.turn_period_s, 3 * recording.turn_period_s
        rows = (recording.t >= begin - 1e-9) & (recording.t < end - 1e-9)
        disturbance = recording.v[rows] - recording.commanded_speed_rps
        parts.append(
            pd.DataFrame({"delta_rad": delta, "time_s": recording.t[rows] - begin, "disturbance_rps": disturbance})
        )
    return pd.concat(parts, ignore_index=True)
