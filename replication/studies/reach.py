"""How far the self-calibrated sensor reaches: shorter, coarser and rougher logs beside the bound, and what one says."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from replication.datasets import Recording
from replication.methods.joint_match import changed
from replication.methods.joint_posterior import LEAST_BACKLASH, UNIT_RAD
from replication.methods.joint_search import find_joint, find_peak
from replication.methods.self_calibration import MEASURED_AS, fit_joint, posed
from replication.standins.joints import Bench, encoder_log
from replication.studies.population import bench_bound_rad


def limits(bench: Bench, delta_rad: float, seed: int, harder: Mapping[str, Sequence[float]]) -> pd.DataFrame:
    """Measure a bench's log as one thing after the other gets worse.

    Parameters
    ----------
    bench : Bench
        The joint.
    delta_rad : float
        Its backlash [rad].
    seed : int
        Of the logs' start and noise, the same for all.
    harder : mapping of str to sequence of float
        What is made worse, and to what: `turns` in the log, `samples made one`, `encoder bits`, `load friction`
        (Coulomb friction added to the load, over m g r).

    Returns
    -------
    DataFrame
        `what, value, error_rad, sd_rad, bound_rad, answer`; where the log cannot be fitted, error, SD and bound
        are NaN, and `answer` says why.
    """
    rows = []
    for what, values in harder.items():
        for value in values:
            worse, log = _made_harder(bench, delta_rad, np.random.default_rng(seed), what, value)
            try:
                found = fit_joint(log)
            except ValueError as error:
                rows.append((what, value, np.nan, np.nan, np.nan, str(error).split(": ", 1)[-1]))
                continue
            bound = bench_bound_rad(worse, delta_rad, log)
            answer = found.refusal_reason.split(" (")[0] or "yes"
            rows.append((what, value, found.delta_rad - delta_rad, found.sd_rad, bound, answer))
    return pd.DataFrame(rows, columns=["what", "value", "error_rad", "sd_rad", "bound_rad", "answer"])


def _made_harder(
    bench: Bench, delta_rad: float, rng: np.random.Generator, what: str, value: float
) -> tuple[Bench, Recording]:
    joint = bench.joint
    if what == "encoder bits":
        bench = replace(bench, joint=replace(joint, encoder_bits=int(value)))
    elif what == "load friction":
        bench = replace(bench, joint=changed(joint, {"friction": value}))
    log = encoder_log(bench, delta_rad, rng)
    if what == "turns":
        kept = round(value * log.turn_period_s / log.sample_s)
        log = replace(log, t=log.t[:kept], v=log.v[:kept])
    elif what == "samples made one":
        # The mean of differenced positions is the position differenced over the longer period.
        size, each = log.t.size // int(value), int(value)
        log = replace(log, t=log.t[::each][:size], v=log.v[: size * each].reshape(size, each).mean(axis=1))
        bench = replace(bench, noise_rps=bench.noise_rps / np.sqrt(each))
    return bench, log


def profile(recording: Recording, deviations: Sequence[float], steps: int = 12) -> pd.DataFrame:
    """What a log says of each backlash, all else being fitted anew: the posterior without Laplace's approximation.

    Parameters
    ----------
    recording : Recording
        A log whose speed is differenced.
    deviations : sequence of float
        Distance from the most probable backlash, in posterior SDs.
    steps : int
        Gauss-Newton steps of the other unknowns at each.

    Returns
    -------
    DataFrame
        `deviation, delta_rad, chi2`: how much larger the sum of squares is than at its minimum; Laplace's
        approximation says deviation squared.
    """
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
