"""What is simulated and fitted for the claims of notebook 14: a study gives a table."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from joblib import Parallel, delayed
from numpy.random import default_rng
from pandas import DataFrame
from scipy import stats

from replication.best_fit import best_fit
from replication.characteristic import printed_rows
from replication.joint import Joint, Run, change, identified_joint, settled_peak, simulate
from replication.records import add_noise, constant_speed
from replication.signature import TURN, FloatArray, Timing
from replication.table2 import NOTEBOOK, fit
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
        laws = [stats.uniform(noise.min(), np.ptp(noise)), stats.norm(noise.mean(), noise.std())]
        of_laws = [stats.kstest(noise, law.cdf).pvalue for law in laws]
        rows.append([*of_laws, *(2 * stats.norm.sf(np.abs(z)))])
    return DataFrame(rows, columns=["p_uniform", "p_normal", "p_mean", "p_lag_one"])


def amplitudes_without_backlash(seeds: Iterable[int], noise_rps: float) -> FloatArray:
    """|A| [rps] that one run of the authors' search finds in noise alone, for each noise seed."""
    speed = constant_speed()
    fits = Parallel(n_jobs=-1)(
        delayed(fit)(add_noise(speed, noise_rps, default_rng(seed)), NOTEBOOK, seed)
        for seed in seeds
    )
    return np.array([each.amplitude_rps for each in fits])


def impact_phases(joint: Joint, deltas_rad: Iterable[float]) -> DataFrame:
    """When the teeth first meet on the new side, a row a settled half turn.

    `share_passed` counts from the beginning of the load's descent, in which it drives the motor, or
    ascent.
    """
    shares = []
    for delta in deltas_rad:
        run = simulate(joint, delta, sample=5e-5, step=5e-5)
        at = np.searchsorted(run.t, run.impacts)
        side = run.gap[at]
        new_side = np.r_[False, side[1:] != side[:-1]]
        at = at[new_side & (run.impacts >= joint.turn_period)]
        since = run.theta_l[at] - np.pi * (run.gap[at] < 0)
        shares.append(((since + np.pi / 2) % TURN - np.pi / 2) / np.pi)
    return DataFrame({"share_passed": np.concatenate(shares)})


NOISES = 160  # for each number of turns and backlash


def planned_errors() -> list[tuple[float, int, int]]:
    """Backlash [rad] of Table 2's first, fifth and last row, turns of model and record, number of the noise."""
    deltas = printed_rows()["delta_rad"].iloc[[0, 4, 9]]
    return [*product(deltas, (1, 12), range(1, NOISES + 1))]


def measure_error(delta_rad: float, turns: int, noise: int) -> dict[str, float]:
    """Error that a row's uniform noise makes in A, by the turns of model and record: a row of `noise_by_turns.csv`.

    The identified joint's record begins with the third turn; the error is against its own fit without noise. The
    noise's number and what it is added to fix it.
    """
    rows = printed_rows()
    printed = rows.loc[(rows["delta_rad"] - delta_rad).abs().idxmin()]
    record = clean_record(identified_joint(), printed["delta_rad"], 14)
    turn = round(record.turn_period_s / record.sample_s)
    length = turns * turn + 1
    part = replace(record, t=record.t[:length], v=record.v[2 * turn : 2 * turn + length])
    rng = default_rng((turns, round(1e7 * delta_rad), noise))
    settings = replace(NOTEBOOK, timing=Timing(n=turns))
    quiet, noisy = (
        best_fit(each, settings).amplitude_rps
        for each in (part, add_noise(part, printed["noise"], rng))
    )
    return {"delta_rad": delta_rad, "turns": turns, "noise": noise, "error_rps": noisy - quiet}


LOGS = 4  # for each friction


def friction_study(joint: Joint, shares: Sequence[float], delta_rad: float = 1e-3) -> DataFrame:
    """Mean A of best fits to four logs without noise, by Coulomb friction on the load over m g r, and its change."""
    table = DataFrame({"friction": (0.0, *shares)})
    rubbing = (joint._replace(load_coulomb=share * joint.G) for share in table["friction"])
    cases = [(Bench(each, 0.0), delta_rad) for each in rubbing for _ in range(LOGS)]
    A = fit_logs(cases, seed=1)["A_rps"].to_numpy().reshape(-1, LOGS).mean(axis=1)
    return table.assign(A_rps=A, change_percent=100 * (A / A[0] - 1))


def peak_change_percent(joint: Joint, factors: Mapping[str, float], delta_rad: float) -> float:
    """How much [%] the settled peak changes, with either sign, if ratios of a joint are multiplied."""
    before, after = (
        settled_peak(simulate(each, delta_rad, sample=5e-5, step=5e-5), each)
        for each in (joint, change(joint, factors))
    )
    return 100 * abs(after / before - 1)


def read_amplitude(joint: Joint, run: Run, bits: int, offset_rad: float) -> float:
    """A [rps] of the best fit to a run's positions by an encoder that is turned by an offset."""
    source = f"simulated joint, {bits}-bit encoder"
    angle = run.theta_m + offset_rad
    return best_fit(read_encoder(joint, run.t, angle, TURN / 2**bits, source)).amplitude_rps


def bits_study(
    joint: Joint, deltas_rad: Sequence[float], bits: Sequence[int], offsets: int
) -> DataFrame:
    """Change of A by an encoder's bits against a fine one, a row for each backlash, bits, and angle of mounting."""
    angles = default_rng(1).uniform(0, TURN, offsets)
    rows = []
    for delta in deltas_rad:
        run = simulate(joint, delta, 12 * joint.turn_period)
        fine = read_amplitude(joint, run, FINE_BITS, 0.0)
        for each, angle in product(bits, angles):
            change = abs(read_amplitude(joint, run, each, angle) - fine)
            rows.append((each, delta, change))
    return DataFrame(rows, columns=["bits", "delta_rad", "change_rps"])
