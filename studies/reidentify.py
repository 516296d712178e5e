"""The identified joint, found again from the authors' clean records and a rough start."""

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from replication.records import authors_file
from replication.simulator.identification import JointFit, identify_joint, identify_lead
from replication.simulator.parameters import joint_from_ratios
from replication.records import load_clean_records

FIT_LEVELS = (3, 6, 9, 12)  # levels K whose records identify the joint; the others validate it

# Rough values, from which the fit finds the identified ones; with all signs right, which it keeps.
ROUGH_RATIOS = {
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
MOST_LEAD_PERIODS = 160  # of the drive, that are tried for the lead


def reidentify_joint() -> str:
    """Identify the joint from the authors' clean records: the text of ``data/joint.json``."""
    records = load_clean_records(FIT_LEVELS)
    start = joint_from_ratios(ROUGH_RATIOS)
    fit = identify_joint(records, start)
    leads = start.control_period_s * np.arange(MOST_LEAD_PERIODS + 1)
    lead = identify_lead(records, fit.parameters, leads)
    fit = replace(fit, parameters=replace(fit.parameters, lead_s=float(round(lead, 9))))
    sources = [authors_file(f"Speeddata{level}.xlsx") for level in FIT_LEVELS]
    return joint_text(fit, sources, {name: version(name) for name in ("numpy", "scipy", "numba")})


def joint_text(fit: JointFit, sources: Iterable[Path], versions: Mapping[str, str]) -> str:
    """Return an identified joint and its provenance as the text that `identified_joint` reads."""
    p = fit.parameters
    data = {
        "ratios": {name: float(f"{value:.7g}") for name, value in p.ratios.items()},
        "drive": {
            "control_period_s": p.control_period_s,
            "control_delay_periods": p.control_delay_periods,
        },
        "confidence_95": {
            name: [float(f"{x:.4g}") for x in pair] for name, pair in fit.confidence.items()
        },
        "root_mean_square": float(f"{math.sqrt(fit.mean_square):.4g}"),
        "sources": {
            path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(sources)
        },
        "versions": dict(versions),
    }
    return json.dumps(data, indent=2) + "\n"
