"""Records and printed amplitudes to hold the simulated joint against, changes of it, and its identification."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pandas as pd

from replication import published
from replication.authors import authors_file, level_delta_rad, load_clean
from replication.recording import Recording
from replication.simulator.identification import FINE_S, identify_joint, identify_lead, joint_record
from replication.simulator.parameters import JointParameters, joint_from_ratios, with_ratios
from replication.simulator.simulate import settled_peak_rps, simulate_many

# Levels K of the authors' data: published clean, used to identify the joint, and all that they made.
CLEAN_LEVELS = range(3, 14)
FIT_LEVELS = (3, 6, 9, 12)
ALL_LEVELS = range(2, 21)


def clean_records(levels: Sequence[int]) -> dict[float, Recording]:
    """Load the authors' clean records of some levels, by backlash [rad]."""
    return {level_delta_rad(level): load_clean(level) for level in levels}


def printed_amplitudes() -> dict[float, float]:
    """Table 2's theoretical A [rps] by backlash [rad]."""
    theoretical = published.column("Table 2", "theoretical")
    return {level_delta_rad(level): theoretical[level - 2] for level in range(2, 2 + theoretical.size - 1)}


def amplitudes(joint: JointParameters, deltas_rad: Sequence[float]) -> pd.DataFrame:
    """Measure the theoretical A of the simulated joint: the settled peak before sampling at 2 ms."""
    runs = simulate_many(joint, deltas_rad, sample_s=FINE_S, step_s=FINE_S)
    return pd.DataFrame({"delta_rad": deltas_rad, "amplitude_rps": [settled_peak_rps(run, joint) for run in runs]})


def changeable(joint: JointParameters) -> tuple[str, ...]:
    """Names of what `changed_joint` takes: a joint's ratios, and its physical quantities that are not zero."""
    physical = {name for name, value in vars(joint).items() if isinstance(value, float) and 0 < abs(value) < math.inf}
    return tuple(sorted(physical | set(joint.ratios)))


def changed_joint(joint: JointParameters, factors: Mapping[str, float]) -> JointParameters:
    """Multiply some of a joint's ratios, the other ratios kept, then physical quantities, all other ones kept."""
    if unknown := set(factors) - set(changeable(joint)):
        raise ValueError(f"cannot change {', '.join(sorted(unknown))}; there are {', '.join(changeable(joint))}")
    ratios = {name: factor * joint.ratios[name] for name, factor in factors.items() if name in joint.ratios}
    joint = with_ratios(joint, ratios) if ratios else joint
    return replace(joint, **{name: factors[name] * getattr(joint, name) for name in factors if name not in ratios})


# Rough values, from which the fit finds the identified ones; with all signs right, which it keeps.
CALIBRATION_START = {
    "stiffness_per_s2": 4.5e4,
    "gravity_per_s2": 33.0,
    "inertia_ratio": 5.0,
    "speed_gain_per_s": 850.0,
    "integral_gain_per_s2": 1.5e5,
    "derivative_gain": 1.0,
    "leaky_gain_per_s2": -4e4,
    "position_gain_per_s": 25.0,
    "leaky_rate_per_s": 30.0,
    "torque_lag_s": 1.5e-3,
    "start_angle_rad": 0.149,
    "lead_s": 0.0455,
}


def reidentify_joint() -> str:
    """Identify the joint from the authors' clean records, from a rough start."""
    records = clean_records(FIT_LEVELS)
    start = joint_from_ratios(CALIBRATION_START)
    fit = identify_joint(records, start)
    leads = start.control_period_s * np.arange(0, 161)
    lead = identify_lead(records, fit.parameters, leads)
    fit = replace(fit, parameters=replace(fit.parameters, lead_s=float(round(lead, 9))))
    sources = [authors_file(f"Speeddata{level}.xlsx") for level in FIT_LEVELS]
    return joint_record(fit, sources, {name: version(name) for name in ("numpy", "scipy", "numba")})
