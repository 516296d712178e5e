"""The sensor's default calibrations, on simulated records of Table 2's range of backlash."""

from dataclasses import replace

import numpy as np
from numpy.polynomial import Polynomial

from backlash.calibration import SIMULATED, Calibration, fit_calibration, leave_one_out_sd
from backlash.fitting.readings import METHODS, read
from replication.characteristic import RPM_PER_RPS, equation_10, printed_levels_rad
from replication.records import TURN_PERIOD_S
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings


def compute_default(method: str) -> Calibration:
    """Calibrate a method for the paper's joint; "paper" is equation 10 as printed, with its RMS error here."""
    levels = printed_levels_rad()
    fine = np.round(np.arange(levels[0], levels[-1] + 0.5e-4, 1e-4), 6).tolist()
    records = simulate_recordings(identified_joint(), fine)
    if method != "paper":
        return fit_calibration(records, fine, method, SIMULATED)
    coefficients = equation_10().coefficients * RPM_PER_RPS ** np.arange(4)
    amplitude = np.array([read(record, "amplitude").value for record in records])
    return replace(
        fit_calibration(records, fine, "amplitude"),
        method=method,
        range_rad=(float(levels[0]), float(levels[-1])),
        coefficients=tuple(coefficients.tolist()),
        uncertainty_rad=leave_one_out_sd(Polynomial(coefficients)(amplitude) - fine),
        turn_period_s=TURN_PERIOD_S,
        provenance=f"equation 10 as printed; its error is that on {SIMULATED}",
    )


def compute_defaults() -> dict[str, dict]:
    """What `default_calibrations.json` is to hold."""
    return {name: compute_default(name).to_dict() for name in METHODS if name != "waveform"}
