"""How far the self-calibrated sensor reaches: shorter, coarser and rougher logs of one joint, beside the bound."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from replication.datasets import Recording
from replication.methods.self_calibration import fit_joint
from replication.standins.joints import Bench, encoder_log
from replication.studies.population import bench_bound_rad

# What is made worse, and to what: turns in the log, samples that are made one, bits of the encoder, Coulomb friction
# added to the load over m g r.
HARDER: Mapping[str, Sequence[float]] = {
    "turns": (12, 6, 4, 3),
    "samples made one": (1, 2, 4, 8),
    "encoder bits": (19, 15, 13, 11),
    "load friction": (0.0, 0.1, 0.3, 0.6),
}


def limits(bench: Bench, delta_rad: float, seed: int, harder: Mapping[str, Sequence[float]] = HARDER) -> pd.DataFrame:
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
        As `HARDER`.

    Returns
    -------
    DataFrame
        `what, value, error_rad, sd_rad, bound_rad, answer`; the bound is NaN where friction is not small.
    """
    rows = []
    for what, values in harder.items():
        for value in values:
            changed, log = _made_harder(bench, delta_rad, np.random.default_rng(seed), what, value)
            try:
                found = fit_joint(log)
            except ValueError as error:
                rows.append((what, value, np.nan, np.nan, np.nan, str(error).split(": ", 1)[-1]))
                continue
            bound = bench_bound_rad(changed, delta_rad, log)
            answer = found.doubt.split(" (")[0] or "yes"
            rows.append((what, value, found.delta_rad - delta_rad, found.sd_rad, bound, answer))
    return pd.DataFrame(rows, columns=["what", "value", "error_rad", "sd_rad", "bound_rad", "answer"])


def _made_harder(
    bench: Bench, delta_rad: float, rng: np.random.Generator, what: str, value: float
) -> tuple[Bench, Recording]:
    joint = bench.joint
    if what == "encoder bits":
        bench = replace(bench, joint=replace(joint, encoder_bits=int(value)))
    elif what == "load friction":
        rubbing = joint.load_coulomb_nm + value * joint.gravity_torque_nm
        bench = replace(bench, joint=replace(joint, load_coulomb_nm=rubbing))
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
