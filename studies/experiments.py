"""What is simulated and fitted for the claims of notebook 14: a study gives a table."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product

import numpy as np
from joblib import Parallel, delayed
from pandas import DataFrame
from scipy import stats

from replication import published, table2
from replication.best_fit import best_fit
from replication.characteristic import printed_levels_rad
from replication.joint import Joint, Run, change, identified_joint, settled_peak, simulate
from replication.records import Recording, add_noise, constant_speed
from replication.signature import TURN, FloatArray, Timing
from replication.table2 import NOTEBOOK
from studies.standins import Bench, clean_record, fit_logs, read_encoder

FINE_BITS = 40  # of an encoder without steps


def noise_tests(noises: Iterable[FloatArray]) -> DataFrame:
    """P-values of noises: of two laws (Kolmogorov and Smirnov's), of the mean, of the correlation of neighbours.

    They are not corrected for their number.
    """
    rows = []
    for noise in noises:
        correlation = np.corrcoef(noise[1:], noise[:-1])[0, 1]
        z = [noise.mean() / stats.sem(noise, ddof=0), correlation * np.sqrt(noise.size - 1)]
        p_mean, p_lag_one = 2 * stats.norm.sf(np.abs(z))
        row = {
            "p_uniform": stats.kstest(noise, stats.uniform(noise.min(), np.ptp(noise)).cdf).pvalue,
            "p_normal": stats.kstest(noise, stats.norm(noise.mean(), noise.std()).cdf).pvalue,
            "p_mean": p_mean,
            "p_lag_one": p_lag_one,
        }
        rows.append(row)
    return DataFrame(rows)


def amplitudes_without_backlash(seeds: Sequence[int], noise_rps: float) -> FloatArray:
    """|A| [rps] that one run of the authors' search finds in noise alone, for each noise seed."""
    noises = [add_noise(constant_speed(), noise_rps, np.random.default_rng(seed)) for seed in seeds]
    work = [
        delayed(table2.fit)(noise, NOTEBOOK, seed)
        for noise, seed in zip(noises, seeds, strict=True)
    ]
    return np.array([fit.amplitude_rps for fit in Parallel(n_jobs=-1)(work)])


def impact_phases(joint: Joint, deltas_rad: Sequence[float]) -> DataFrame:
    """When the teeth first meet on the new side, a row a settled half turn.

    `share_passed` counts from the beginning of the load's descent, in which it drives the motor, or
    ascent.
    """
    rows = []
    for delta in deltas_rad:
        run = simulate(joint, delta, sample=5e-5, step=5e-5)
        at = np.searchsorted(run.t, run.impacts)
        side = run.gap[at]
        new_side = np.r_[False, side[1:] != side[:-1]]
        for k in at[new_side & (run.impacts >= joint.turn_period)]:
            descends = run.gap[k] < 0
            turned = (run.theta_l[k] - np.pi * descends + np.pi / 2) % TURN - np.pi / 2
            rows.append((delta, "descent" if descends else "ascent", turned / np.pi))
    return DataFrame(rows, columns=["delta_rad", "phase", "share_passed"])


TURNS = (1, 12)
NOISES = 160  # for each number of turns and backlash


def noise_errors_by_turns(
    joint: Joint, deltas_rad: Iterable[float], noises_rps: Iterable[float], noises: Sequence[int]
) -> DataFrame:
    """Error that uniform noise of an amplitude for each backlash makes in A, by the turns of model and record.

    The record begins with the third turn; the error is against its own fit without noise. A row a noise, whose number
    and what it is added to fix it.
    """
    rows = []
    for (delta, noise_rps), turns in product(zip(deltas_rad, noises_rps, strict=True), TURNS):
        record = clean_record(joint, delta, 2 + max(TURNS))
        turn = round(record.turn_period_s / record.sample_s)
        length = turns * turn + 1
        part = replace(record, t=record.t[:length], v=record.v[2 * turn : 2 * turn + length])
        streams = [np.random.default_rng((turns, round(1e7 * delta), k)) for k in noises]
        parts = [part, *(add_noise(part, noise_rps, rng) for rng in streams)]
        settings = replace(NOTEBOOK, timing=Timing(n=turns))
        fits = Parallel(n_jobs=-1)(delayed(best_fit)(each, settings) for each in parts)
        quiet, *noisy = (fit.amplitude_rps for fit in fits)
        rows += [(delta, turns, k, A - quiet) for k, A in zip(noises, noisy, strict=True)]
    return DataFrame(rows, columns=["delta_rad", "turns", "noise", "error_rps"])


def kept_noise_errors(noises: Sequence[int]) -> DataFrame:
    """`noise_errors_by_turns` of Table 2's first, fifth and last row: what `results/noise_by_turns.csv` keeps."""
    rows = [0, 4, 9]
    printed_rps = published.column("Table 2", "noise")[rows]
    return noise_errors_by_turns(
        identified_joint(), printed_levels_rad()[rows], printed_rps, noises
    )


def friction_study(joint: Joint, shares: Sequence[float], delta_rad: float = 1e-3) -> DataFrame:
    """Mean A of best fits to four logs without noise, by Coulomb friction on the load over m g r, and its change."""
    benches = [Bench(joint._replace(load_coulomb=share * joint.G), 0.0) for share in (0.0, *shares)]
    fits = fit_logs([(bench, delta_rad) for bench in benches for _ in range(4)], seed=1)
    A = fits["A_rps"].to_numpy().reshape(-1, 4).mean(axis=1)
    table = DataFrame({"friction": (0.0, *shares), "A_rps": A})
    return table.assign(change_percent=100 * (A / A[0] - 1))


def peak_change_percent(joint: Joint, factors: Mapping[str, float], delta_rad: float) -> float:
    """How much [%] the settled peak changes, with either sign, if ratios of a joint are multiplied."""
    runs = [
        (each, simulate(each, delta_rad, sample=5e-5, step=5e-5))
        for each in (joint, change(joint, factors))
    ]
    before, after = (settled_peak(run, each) for each, run in runs)
    return 100 * abs(after / before - 1)


@lru_cache(1)  # a run is read by one encoder after the other
def _twelve_turns(joint: Joint, delta_rad: float) -> Run:
    return simulate(joint, delta_rad, 12 * joint.turn_period)


def encoder_record(joint: Joint, delta_rad: float, bits: int, offset_rad: float) -> Recording:
    """Record speeds differenced from the positions of an encoder that is turned by an offset."""
    run = _twelve_turns(joint, delta_rad)
    source = f"simulated joint, {delta_rad:g} rad, {bits}-bit encoder"
    return read_encoder(joint, run.t, run.theta_m + offset_rad, TURN / 2**bits, source)


def bits_study(
    joint: Joint, deltas_rad: Sequence[float], bits: Sequence[int], offsets: int
) -> DataFrame:
    """Largest change of A by an encoder's bits, mounted at several angles, against a fine one."""

    def amplitude(delta: float, bits: int, angle: float) -> float:
        return best_fit(encoder_record(joint, delta, bits, angle)).amplitude_rps

    angles = np.random.default_rng(1).uniform(0, TURN, offsets)
    rows = []
    for delta in deltas_rad:
        fine = amplitude(delta, FINE_BITS, 0.0)
        rows += [
            (b, delta, max(abs(amplitude(delta, b, angle) - fine) for angle in angles))
            for b in bits
        ]
    return DataFrame(rows, columns=["bits", "delta_rad", "change_rps"])
