"""How far the self-calibrated sensor reaches: shorter, coarser and rougher logs beside the bound, and what one says."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from replication.datasets import Recording
from replication.methods.joint_match import changed
from replication.methods.joint_posterior import LEAST_BACKLASH, UNIT_RAD
from replication.methods.joint_search import find_joint, find_peak
from replication.methods.self_calibration import MEASURED_AS, fit_joint, posed
from replication.standins.joints import Bench, encoder_log
from replication.studies.benchmark import Log, logs_by_methods
from replication.studies.population import bench_bound_rad


def degrade_logs(bench: Bench, delta_rad: float, seed: int, harder: Mapping[str, Sequence[float]]) -> pd.DataFrame:
    """Measure a bench's log as one thing after the other gets worse, its start and noise the same."""
    logs = [
        partial(_degraded_log, bench, delta_rad, seed, what, value)
        for what, values in harder.items()
        for value in values
    ]
    return logs_by_methods(logs, _answer)[["what", "value", "error_rad", "sd_rad", "bound_rad", "answer"]]


def _answer(log: Log) -> dict[str, dict[str, object]]:
    """Answer of "self"; without a fit error, SD and bound are NaN, and `answer` says why."""
    try:
        fit = fit_joint(log.recording)
    except ValueError as error:
        unknown = dict.fromkeys(("found_rad", "sd_rad", "bound_rad"), np.nan)
        return {"self": unknown | {"answer": str(error).split(": ", 1)[-1]}}
    answer = fit.refusal_reason.split(" (")[0] or "yes"
    return {"self": {"found_rad": fit.delta_rad, "sd_rad": fit.sd_rad, "answer": answer}}


def _degraded_log(bench: Bench, delta_rad: float, seed: int, what: str, value: float) -> Log:
    """Log a bench with fewer turns, a decimation factor, a coarser encoder, or load friction (of m g r)."""
    if what == "encoder bits":
        bench = replace(bench, joint=replace(bench.joint, encoder_bits=int(value)))
    elif what == "load friction":
        bench = replace(bench, joint=changed(bench.joint, {"friction": value}))
    recording = encoder_log(bench, delta_rad, np.random.default_rng(seed))
    if what == "turns":
        kept = round(value * recording.turn_period_s / recording.sample_s)
        recording = replace(recording, t=recording.t[:kept], v=recording.v[:kept])
    elif what == "decimation factor":
        recording = _decimated(recording, int(value))
        bench = replace(bench, noise_rps=bench.noise_rps / np.sqrt(value))
    bound = bench_bound_rad(bench, delta_rad, recording)
    return Log({"what": what, "value": value, "bound_rad": bound}, delta_rad, recording)


def _decimated(recording: Recording, factor: int) -> Recording:
    """Average groups of samples, which is to difference the encoder's position over the longer period."""
    size = recording.t.size // factor
    speed = recording.v[: size * factor].reshape(size, factor).mean(axis=1)
    return replace(recording, t=recording.t[::factor][:size], v=speed)


def profile(recording: Recording, deviations: Sequence[float], steps: int = 12) -> pd.DataFrame:
    """Gain of chi squared, all else fitted, at deviations from the best backlash in SDs; Laplace's is their square."""
    problem, harmonics = posed(recording)
    peak = find_peak(problem, find_joint(problem, harmonics)[0], MEASURED_AS["differenced"][1:])
    along = peak.covariance[:, 0] / np.sqrt(peak.covariance[0, 0])
    least, rows = float(peak.residual @ peak.residual), []
    for deviation in deviations:
        z = peak.z + deviation * along
        z[0] = max(z[0], LEAST_BACKLASH)
        cost = np.inf
        for _ in range(steps):
            residual, slopes = problem.slopes(z)
            if not residual @ residual < cost:
                break
            cost, others = float(residual @ residual), slopes[1:]
            z = z.copy()
            z[1:] -= np.linalg.solve(others @ others.T, others @ residual)
        rows.append((deviation, z[0] * UNIT_RAD, cost - least))
    return pd.DataFrame(rows, columns=["deviation", "delta_rad", "chi2"])
