"""The paper's sentences that need studies of their own (notebook 14).

A study gives a table; `measure_...` reduces it to what the claim's rule in `claims.csv` compares, and to words.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product

import numpy as np
from joblib import Parallel, delayed
from matplotlib.figure import Figure
from pandas import DataFrame
from scipy import stats

from replication import figures, published, table2
from replication.characteristic import printed_levels_rad
from replication.joint import TURN, Joint, Run, change, identified_joint, settled_peak, simulate
from replication.published import Criteria, Measured
from replication.records import Recording, add_noise, constant_speed
from replication.signature import FloatArray, Timing
from replication.standins import Bench, clean_record, fit_logs, read_encoder
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


def measure_uniform_noise(tests: DataFrame) -> Measured:
    """The smallest corrected p of a law that is uniform, white and of zero mean, from `noise_tests`."""
    p = tests[["p_uniform", "p_mean", "p_lag_one"]]
    corrected = (p.min() * p.size).clip(upper=1.0)
    uniform, mean, lag_one = corrected
    return corrected.min(), (
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


def measure_no_backlash(amplitude_rps: FloatArray, smallest_A_rps: float) -> Measured:
    """The 95th percentile of |A| in noise alone, as a share of the smallest A with backlash."""
    share = np.sort(amplitude_rps) / smallest_A_rps
    # The order statistics that hold the percentile: nan where there are too few for 95 % confidence.
    low, high = stats.quantile_test(share, p=0.95).confidence_interval(0.95)
    limit = published.criterion("no_backlash")
    return (low, high), (
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


def measure_impacts(phases: DataFrame) -> Measured:
    """The largest share of its phase that has passed at an impact, from `impact_phases`."""
    passed = phases["share_passed"]
    first, last = 100 * passed.min(), 100 * passed.max()
    words = f"{first:.0f} to {last:.0f} % of the phase has passed at the impact"
    return (
        passed % 1
    ).max(), words  # what comes before its phase comes at the end of the one before


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


def measure_turns(errors: DataFrame) -> Measured:
    """The RMS error of the longest records over that of the shortest, from `noise_errors_by_turns`."""
    squares = (errors["error_rps"] ** 2).groupby([errors["delta_rad"], errors["turns"]])
    table = np.sqrt(squares.mean()).unstack()
    few, many = table.columns.min(), table.columns.max()
    ratio = table[many] / table[few]
    noises = squares.size().min()
    # F's own quantiles at 0.025 and 0.975 are inverses.
    factor = np.sqrt(stats.f.ppf(0.975, noises, noises))
    interval = ratio.max() / factor, ratio.max() * factor
    ratios = ", ".join(f"{r:.2f}" for r in ratio)
    return interval, (
        f"error with {many} turns over that with {few} at three backlashes: {ratios} (each within a factor "
        f"{factor:.2f}, {noises} noises)"
    )


def friction_study(joint: Joint, shares: Sequence[float], delta_rad: float = 1e-3) -> DataFrame:
    """Mean A of best fits to four logs without noise, by Coulomb friction on the load over m g r, and its change."""
    benches = [Bench(joint._replace(load_coulomb=share * joint.G), 0.0) for share in (0.0, *shares)]
    fits = fit_logs([(bench, delta_rad) for bench in benches for _ in range(4)], seed=1)
    A = fits["A_rps"].to_numpy().reshape(-1, 4).mean(axis=1)
    table = DataFrame({"friction": (0.0, *shares), "A_rps": A})
    return table.assign(change_percent=100 * (A / A[0] - 1))


def measure_friction(study: DataFrame) -> Measured:
    """The smallest and the largest change of A by friction, from `friction_study`."""
    rubbed = study[study["friction"] > 0]
    changes = rubbed["change_percent"].abs()
    shares = 100 * rubbed["friction"]
    return (changes.min(), changes.max()), (
        f"on simulated logs frictions of {shares.min():.2g} to {shares.max():.2g} % of gravity change A by "
        f"{changes.min():.1f} to {changes.max():.0f} %; the friction of the test's joint is not published"
    )


def measure_dependence(joint: Joint, delta_rad: float) -> Measured:
    """How much [%] the settled peak changes if the stiffness is a fifth lower."""
    softer = change(joint, {"K_s/J_l": 0.8})
    fine = {"sample": 5e-5, "step": 5e-5}
    peaks = [settled_peak(simulate(each, delta_rad, **fine), each) for each in (joint, softer)]
    changed = 100 * abs(peaks[1] / peaks[0] - 1)
    return changed, f"a stiffness a fifth lower changes the settled peak by {changed:.2g} %"


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


def measure_bits(study: DataFrame, bits: int) -> Measured:
    """The largest change of A by an encoder of so many bits, from `bits_study`."""
    largest = study.groupby("bits")["change_rps"].max()
    limit = published.criterion("bits_suffice")
    enough = [b for b in largest.index if (largest.loc[b:] < limit).all()]
    least = f"; the fewest tried that suffice: {min(enough)}" if enough else ""
    return largest[bits], f"{bits} bits change A by up to {largest[bits]:.2g} rps{least}"


def measure_discontinuities(study: DataFrame) -> Measured:
    """How much a torque that steps spoils a simulation, and it alone, from `stepping_torque_study`.

    An error below the limit refutes the claim only if the smooth torque's is no smaller: stability,
    other systems and other solvers were not tried.
    """
    errors = study.pivot(index=["delta_rad", "step_s"], columns="model", values="error")
    by_case = errors.abs().fillna(np.inf)
    sound = by_case["modified"] <= published.criterion("discontinuities_destabilise")
    alone, largest = by_case.loc[sound, "stepping"].max(), by_case.max()
    most = np.inf if largest["stepping"] > largest["modified"] else largest["stepping"]
    sizes = largest.map(lambda error: "diverges" if np.isinf(error) else f"{100 * error:.2g} %")
    named = ", ".join(sizes.index + " " + sizes)
    return (alone, most), f"largest error of the settled peak: {named}; stability was not measured"


def measure_swarms(compared: DataFrame) -> Measured:
    """P that CMA-ES beats every swarm, and that one beats it, from `optimizers.against_swarms`."""
    better, worse = compared["p_cma_better"].max(), compared["p_swarm_better"].min()
    p = len(compared) * better, len(compared) * worse
    rates = ", ".join(
        f"{row.swarm} {row.rate:.2f} (p {row.p_cma_better:.1g})" for row in compared.itertuples()
    )
    return p, f"rates of the best basin: CMA-ES {compared['rate_cma'].iloc[0]:.2f}, {rates}"


def measure_classical(table: DataFrame, kind: str) -> Measured:
    """How often classical methods of a kind, "classical" or "prepared", succeed, from `optimizers.success_table`."""
    classical = table[table["kind"] == kind]
    rates = ", ".join(f"{row.method} {row.found} of {row.runs}" for row in classical.itertuples())
    return tuple(classical[_INTERVAL].max()), f"best basin found: {rates}"


def measure_tuning(table: DataFrame) -> Measured:
    """How often CMA-ES succeeds with its own settings, from `optimizers.success_table`."""
    untuned = table[table["method"].str.startswith("CMA-ES, its own population")]
    rates = ", ".join(
        f"{row.method}: {row.rate:.2f} ({row.rate_low:.2f} to {row.rate_high:.2f})"
        for row in untuned.itertuples()
    )
    low, high = untuned[_INTERVAL[0]].min(), untuned[_INTERVAL[1]].max()
    return (low, high), f"rate of the best basin, {rates}"


def margin(
    claim: str, measured: float | tuple[float, float], criteria: Criteria = None
) -> tuple[float, float]:
    """Ends of what was measured over the claim's limit, turned so that below 1 it holds and above 1 it does not."""
    limit, rule = published.criterion(claim, criteria), published.table("claims").loc[claim, "rule"]
    numbers = np.ravel(measured).astype(float)
    with np.errstate(divide="ignore"):
        if rule == "rounds to":
            ends = np.abs(numbers - limit) / published.half_last_digit(str(limit))
        elif rule == "p below":  # p of the claim, and of its opposite
            ends = np.array([numbers[0] / limit, limit / numbers[1]])
        elif "below" in rule or rule == "at most":
            ends = numbers / limit
        else:
            ends = limit / numbers
    return float(ends.min()), float(ends.max())


LOOKS: dict[bool | None, tuple[str, str, str]] = {
    True: ("holds", figures.BLUE, "o"),
    False: ("does not hold", figures.VERMILION, "X"),
    None: ("undecided", figures.INK, "D"),
}


@figures.in_style
def draw_margins(measured: Mapping[str, Measured], criteria: Criteria = None) -> Figure:
    """What was measured of each claim over its limit, sorted: left of 1 it holds, right of 1 it does not."""
    ends = sorted(
        (*margin(claim, numbers, criteria), claim) for claim, (numbers, _) in measured.items()
    )
    figure, axis = figures.panel(0.6 + 0.22 * len(ends))
    for row, (low, high, claim) in enumerate(ends):
        label, colour, mark = LOOKS[published.decide(claim, measured[claim][0], criteria)]
        inside = np.clip([low, high], 1.2e-2, 80)
        axis.plot(inside, [row, row], color=colour, marker=mark, markersize=5, label=label)
    axis.axvline(1, **figures.DOTTED | {"linewidth": 1.2})
    axis.set_yticks(range(len(ends)), [claim.replace("_", " ") for *_, claim in ends])
    axis.set(xscale="log", xlim=(1e-2, 100), xlabel="measured over limit")
    axis.invert_yaxis()
    return figures.finish(figure, 3)
