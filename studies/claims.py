"""Decisions on the paper's prose claims that belong to no single figure or table (notebook 16).

A study gives a table. A decision reduces it to the numbers that the claim's rule in
`data/claims.csv` reads.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from joblib import Parallel, delayed
from pandas import DataFrame
from scipy import stats

from replication import published, table2
from replication.bench import clean_record, read_encoder
from replication.joint import TURN, Joint, simulate
from replication.published import Criteria, Decision
from replication.records import Recording, add_noise, constant_speed
from replication.signature import FloatArray, Timing
from replication.table2 import NOTEBOOK, best_fit

FINE_BITS = 40  # of an encoder without steps
_INTERVAL = ["rate_low", "rate_high"]


def uniform_noise_test(noise: FloatArray) -> dict[str, float]:
    """P-values of a noise: of two laws (Kolmogorov and Smirnov's), of its mean, of the correlation of neighbours."""
    correlation = np.corrcoef(noise[1:], noise[:-1])[0, 1]
    z = [noise.mean() / stats.sem(noise, ddof=0), correlation * np.sqrt(noise.size - 1)]
    p_mean, p_lag_one = 2 * stats.norm.sf(np.abs(z))
    return {
        "p_uniform": stats.kstest(noise, stats.uniform(noise.min(), np.ptp(noise)).cdf).pvalue,
        "p_normal": stats.kstest(noise, stats.norm(noise.mean(), noise.std()).cdf).pvalue,
        "p_mean": p_mean,
        "p_lag_one": p_lag_one,
    }


def noise_tests(noises: Mapping[tuple[int, int], FloatArray]) -> DataFrame:
    """Test the noise added to records, by (level, realisation), for its law, its mean and correlation of neighbours.

    P-values are not corrected for their number; those of the law are Kolmogorov and Smirnov's.
    """
    tested = DataFrame([uniform_noise_test(noise) for noise in noises.values()])
    return DataFrame(list(noises), columns=["level", "realisation"]).join(tested)


def uniform_noise(tests: DataFrame, criteria: Criteria = None) -> Decision:
    """Whether the noise is uniform, white and of zero mean, from `noise_tests`."""
    p = tests[["p_uniform", "p_mean", "p_lag_one"]]
    corrected = (p.min() * p.size).clip(upper=1.0)
    uniform, mean, lag_one = corrected
    return published.decide("uniform_noise", corrected.min(), criteria), (
        f"smallest p of {len(p)} records times {p.size}: uniform {uniform:.2g}, mean {mean:.2g}, lag one "
        f"{lag_one:.2g}; normal noise: at most {tests['p_normal'].max():.1g} uncorrected"
    )


def amplitudes_without_backlash(seeds: Sequence[int], noise_rps: float) -> FloatArray:
    """|A| [rps] that one run of the authors' search finds in noise alone, for each noise seed."""
    noises = [add_noise(constant_speed(), noise_rps, np.random.default_rng(seed)) for seed in seeds]
    work = [
        delayed(table2.fit)(noise, NOTEBOOK, seed)
        for noise, seed in zip(noises, seeds, strict=True)
    ]
    return np.array([fit.amplitude_rps for fit in Parallel(n_jobs=-1)(work)])


def no_backlash(
    amplitude_rps: FloatArray, smallest_A_rps: float, criteria: Criteria = None
) -> Decision:
    """Whether noise is recognised: the 95th percentile of |A| is a small share of the smallest A."""
    share = np.sort(amplitude_rps) / smallest_A_rps
    # The order statistics that hold the percentile: nan where there are too few for 95 % confidence.
    low, high = stats.quantile_test(share, p=0.95).confidence_interval(0.95)
    limit = published.criterion("no_backlash", criteria)
    return published.decide("no_backlash", (low, high), criteria), (
        f"95th percentile of |A| over the smallest mean: {np.quantile(share, 0.95):.2f} (95 % interval {low:.2f} to "
        f"{high:.2f}); it is below {limit:.2g} in {(share < limit).sum()} of {share.size} noise records; mean |A| "
        f"{amplitude_rps.mean():.3f}, largest {amplitude_rps.max():.3f} rps"
    )


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


def impacts_at_phase_start(phases: DataFrame, criteria: Criteria = None) -> Decision:
    """Whether each impact comes at the beginning of its phase, from `impact_phases`."""
    passed = phases["share_passed"]
    # What comes before its phase comes at the end of the one before.
    holds = published.decide("impacts_at_phase_start", (passed % 1).max(), criteria)
    first, last = 100 * passed.min(), 100 * passed.max()
    return holds, f"{first:.0f} to {last:.0f} % of the phase has passed at the impact"


def noise_errors_by_turns(
    joint: Joint,
    deltas_rad: Sequence[float],
    noises_rps: Sequence[float],
    turns: Sequence[int],
    seeds: int,
) -> DataFrame:
    """RMS error that uniform noise of an amplitude for each backlash makes in A, by the turns of model and record.

    The record begins with the third turn; the error is against its own fit without noise.
    """
    records = [clean_record(joint, delta, 2 + max(turns)) for delta in deltas_rad]
    rows = []
    for (record, noise, delta), n in product(
        zip(records, noises_rps, deltas_rad, strict=True), turns
    ):
        turn = round(record.turn_period_s / record.sample_s)
        length = n * turn + 1
        part = replace(record, t=record.t[:length], v=record.v[2 * turn : 2 * turn + length])
        rng = np.random.default_rng((n, round(1e7 * delta)))
        parts = [part, *(add_noise(part, noise, rng) for _ in range(seeds))]
        settings = replace(NOTEBOOK, timing=Timing(n=n))
        fits = Parallel(n_jobs=-1)(delayed(best_fit)(each, settings) for each in parts)
        quiet, *noisy = (fit.amplitude_rps for fit in fits)
        rows.append((delta, n, np.sqrt(np.mean((np.array(noisy) - quiet) ** 2))))
    return DataFrame(rows, columns=["delta_rad", "turns", "rms_error_rps"])


def turns_reduce_noise(errors: DataFrame, seeds: int, criteria: Criteria = None) -> Decision:
    """Whether the longest records err less than the shortest, from `noise_errors_by_turns`."""
    table = errors.pivot(index="delta_rad", columns="turns", values="rms_error_rps")
    few, many = table.columns.min(), table.columns.max()
    ratio = table[many] / table[few]
    # F's own quantiles at 0.025 and 0.975 are inverses.
    factor = np.sqrt(stats.f.ppf(0.975, seeds, seeds))
    interval = ratio.max() / factor, ratio.max() * factor
    ratios = ", ".join(f"{r:.2f}" for r in ratio)
    return published.decide("turns_reduce_noise", interval, criteria), (
        f"error with {many} turns over that with {few}: {ratios} (each within a factor {factor:.2f})"
    )


def encoder_record(joint: Joint, delta_rad: float, bits: int, offset_rad: float) -> Recording:
    """Record speeds differenced from the positions of an encoder that is turned by an offset."""
    run = simulate(joint, delta_rad, 12 * joint.turn_period)
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


def bits_suffice(study: DataFrame, bits: int, criteria: Criteria = None) -> Decision:
    """Whether an encoder of so many bits leaves A unchanged, from `bits_study`."""
    largest = study.groupby("bits")["change_rps"].max()
    limit = published.criterion("bits_suffice", criteria)
    enough = [b for b in largest.index if (largest.loc[b:] < limit).all()]
    least = f"; the fewest tried that suffice: {min(enough)}" if enough else ""
    holds = published.decide("bits_suffice", largest[bits], criteria)
    return holds, f"{bits} bits change A by up to {largest[bits]:.2g} rps{least}"


def discontinuities_destabilise(study: DataFrame, criteria: Criteria = None) -> Decision:
    """Whether a torque that steps, and it alone, spoils a simulation, from `stepping_torque_study`.

    An error below the limit refutes the claim only if the smooth torque's is no smaller: stability,
    other systems and other solvers were not tried.
    """
    errors = study.pivot(index=["delta_rad", "step_s"], columns="model", values="error")
    by_case = errors.abs().fillna(np.inf)
    sound = by_case["modified"] <= published.criterion("discontinuities_destabilise", criteria)
    alone, largest = by_case.loc[sound, "stepping"].max(), by_case.max()
    most = np.inf if largest["stepping"] > largest["modified"] else largest["stepping"]
    holds = published.decide("discontinuities_destabilise", (alone, most), criteria)
    sizes = largest.map(lambda error: "diverges" if np.isinf(error) else f"{100 * error:.2g} %")
    named = ", ".join(sizes.index + " " + sizes)
    return holds, f"largest error of the settled peak: {named}; stability was not measured"


def cma_beats_swarms(compared: DataFrame, criteria: Criteria = None) -> Decision:
    """Whether CMA-ES beats every swarm, from `optimizers.against_swarms`."""
    better, worse = compared["p_cma_better"].max(), compared["p_swarm_better"].min()
    p = len(compared) * better, len(compared) * worse
    rates = ", ".join(
        f"{row.swarm} {row.rate:.2f} (p {row.p_cma_better:.1g})" for row in compared.itertuples()
    )
    return published.decide("cma_beats_swarms", p, criteria), f"rates of the best basin: {rates}"


def classical_cannot(table: DataFrame, criteria: Criteria = None) -> Decision:
    """Whether no classical method is applicable as it comes, from `optimizers.success_table`."""
    classical = table[table["kind"].isin(["classical", "deterministic"])]
    rates = ", ".join(f"{row.method} {row.found} of {row.runs}" for row in classical.itertuples())
    return published.decide("classical_cannot", classical[_INTERVAL].max(), criteria), (
        f"best basin found off the shelf: {rates}"
    )


def little_tuning(table: DataFrame, criteria: Criteria = None) -> Decision:
    """Whether CMA-ES succeeds with its own settings, from `optimizers.success_table`."""
    untuned = table[table["method"].str.startswith("CMA-ES, its own population")]
    rates = ", ".join(
        f"{row.method}: {row.rate:.2f} ({row.rate_low:.2f} to {row.rate_high:.2f})"
        for row in untuned.itertuples()
    )
    return published.decide(
        "little_tuning", untuned[_INTERVAL].max(), criteria
    ), f"rate of the best basin, {rates}"
