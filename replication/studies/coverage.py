"""How often the global fit's interval of A holds the truth, on made records."""

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from replication.arrays import FloatArray
from replication.datasets import Recording
from replication.global_fit.fit import global_fit
from replication.identify import Protocol, protocol_box
from replication.signature import signature
from replication.statistics import rate_columns

DT_S, SAMPLES, OFFSET_RPS = 0.002, 2401, 100.0


def draw_signature(generator: np.random.Generator) -> FloatArray:
    """Draw a signature like those of the authors' records: parameters in `signature.FREE_PARAMETERS` order."""
    A, t0, tau = generator.uniform(0.3, 1.5), generator.uniform(0.002, 0.15), generator.uniform(10, 25)
    omega, T1 = generator.uniform(100, 170), generator.uniform(0.002, 0.02)
    return np.array([A, t0, tau, omega, OFFSET_RPS, T1 + generator.uniform(0.1, 0.17), T1])


def draw_noise(law: str, half_amplitude_rps: float, generator: np.random.Generator) -> FloatArray:
    """Draw a record's noise [rps]: "uniform", or "Gaussian" with the same SD."""
    if law == "uniform":
        return generator.uniform(-half_amplitude_rps, half_amplitude_rps, SAMPLES)
    return generator.normal(0, half_amplitude_rps / np.sqrt(3), SAMPLES)


def midway_amplitude(X: FloatArray) -> float:
    """|A| of the same signal if its window starts midway between two samples: the convention of `GlobalFit` [rps]."""
    A, t0, tau, _, _, _, T1 = X
    midway = (np.ceil((t0 + T1) / DT_S) - 0.5) * DT_S
    return float(abs(A) * np.exp(-tau * (midway - t0 - T1)))


def coverage_runs(law: str, half_amplitude_rps: float, runs: int, generator: np.random.Generator) -> pd.DataFrame:
    """Fit made records whose A is known and lies in the box that the record gives."""
    t, protocol, rows = DT_S * np.arange(SAMPLES), Protocol(), []
    while len(rows) < runs:
        X = draw_signature(generator)
        v = OFFSET_RPS + signature(t, X, protocol.timing) + draw_noise(law, half_amplitude_rps, generator)
        record = Recording(t, v, OFFSET_RPS, protocol.T_f, "made")
        truth = midway_amplitude(X)
        if truth >= protocol_box(record, protocol).upper[0]:
            continue
        fit = global_fit(record, protocol)
        low, high = fit.amplitude_interval_rps
        rows.append([law, half_amplitude_rps, truth, fit.amplitude_rps, low, high, low <= truth <= high])
    names = ["law", "half_amplitude_rps", "true_A_rps", "A_rps", "low_rps", "high_rps", "covered"]
    return pd.DataFrame(rows, columns=names)


def coverage_table(runs: int, seed: int) -> pd.DataFrame:
    """How often the 95 % interval covers, for both noise laws at three noise levels."""
    settings = [(law, half_amplitude) for law in ("uniform", "Gaussian") for half_amplitude in (0.05, 0.15, 0.3)]
    seeds = np.random.SeedSequence(seed).spawn(len(settings))  # rows that shared draws would err together
    jobs = [
        delayed(coverage_runs)(*setting, runs, np.random.default_rng(own))
        for setting, own in zip(settings, seeds, strict=True)
    ]
    rows = []
    for setting, part in zip(settings, Parallel(n_jobs=-1)(jobs), strict=True):
        width = ((part["high_rps"] - part["low_rps"]) / part["true_A_rps"]).median()
        head = dict(zip(("law", "half_amplitude_rps"), setting, strict=True)) | {"runs": runs}
        rows.append(head | rate_columns(int(part["covered"].sum()), runs) | {"relative_width": width})
    return pd.DataFrame(rows)
