"""The paper's sentences as claims: what is measured of each, what of that its rule compares, and the words for it.

A function `measure_...` gives named numbers by claim; `CLAIMS` has the words, in which each number is written once.
Rules and limits stand in `claims.csv`.
"""

import string
from collections.abc import Collection, Mapping
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from pandas import DataFrame, Series
from scipy import stats

from replication import published
from replication.characteristic import (
    encoder_step_rad,
    equation_10,
    printed_rows,
    relative_error_percent,
)
from replication.joint import K_BL, Joint, tau_l
from replication.published import Criteria, Measured
from replication.records import Recording, authors_checksums
from replication.signature import FloatArray
from replication.table2 import SETTINGS, basin_labels

Numbers = Mapping[str, Any]  # by name; "rows", a table of such, where the words name several


class Claim(NamedTuple):
    """How what is measured of a claim is compared and said."""

    words: str  # `{name:1e3×.2f}` writes a thousand times a number
    row: str = ""  # words for each of `rows`
    between: str = ", "  # them
    # Names of the one or two numbers that its rule takes.
    compared: str | tuple[str, str] = ("low", "high")


CLAIMS = {
    # The disturbance.
    "two_impacts": Claim(
        "in {alternating} of {records} records the largest excursion changes its sign from every settled half turn to "
        "the next",
        compared="share",
    ),
    "half_turn": Claim(
        "inverted and half a turn later a record differs from itself by {low:100×.1f} to {high:100×.1f} % of "
        "its SD",
        compared="high",
    ),
    "amplitude_grows": Claim(
        "smallest increase from level to level [rps]: {rows}", "{name} {step_rps:.3f}"
    ),
    "same_amplitude": Claim(
        "settled half turns differ by up to {settled:100×.1f} % in RMS, with the first turn by up to {whole:100×.1f} %",
        compared="settled",
    ),
    # The dead zone.
    "stiffness_zero_inside": Claim(
        "true in the limit of a large alpha, which is not printed; in mid-gap {rows}; at the edge {at_edge:100×.0f} % "
        "whatever alpha",
        "{low:100×.2g} to {high:100×.2g} % of K_s at alpha = {alpha} per rad",
    ),
    "no_discontinuity": Claim(
        "the torque jumps at zero by {low:.2g} to {high:.2g} N m", compared="low"
    ),
    # Equation 10, the encoder.
    "monotone": Claim(
        "the smallest slope from 0 rps on is {slope:1e3×.2g} mrad per rps; it misses Table 2's points by at most "
        "{miss_rad:1e3×.2g} mrad",
        compared="slope",
    ),
    "encoder_step": Claim(
        "one step of the encoder is {step_rad:1e3×.3g} mrad", compared="step_rad"
    ),
    "error_rad_small": Claim(
        "{error_rad:.2g} rad at {delta_rad:1e3×.1f} mrad", compared="error_rad"
    ),
    "error_rad_large": Claim(
        "{error_rad:.2g} rad at {delta_rad:1e3×.1f} mrad, {share:100×.0f} % of the printed number, which may be "
        "meant as a bound",
        compared="error_rad",
    ),
    # Table 2.
    "error_below_10": Claim(
        "the largest of the ten printed errors is {percent:.2f} %, in row {row}", compared="percent"
    ),
    "error_below_10_method": Claim(
        "{share:100×.0f} % of our {tables} tables have an error above {limit:g} % ({low:100×.0f} to "
        "{high:100×.0f} % by setting); {rows}; "
        "without row 1, whose record is simulated, {public:100×.0f} %",
        "row {row} in {share:100×.0f} %",
    ),
    "quality_decreases": Claim(
        "in rad the later row errs more in {rows} of our {tables} tables; in percent row {last} errs more than row "
        "{first} in {in_percent:100×.0f} %",
        "{share:100×.0f} % (row {later} against row {earlier})",
        " to ",
    ),
    "local_minima": Claim(
        "runs in the best basin by population: {rows}; {stored_best} of the authors' {stored} stored runs; the paper "
        "prints no population",
        "{share:100×.0f} % ({population})",
    ),
    "noise_proportional": Claim(
        "noise over A falls from {first:.2f} to {last:.3f}, a factor {factor:.2f}",
        compared="factor",
    ),
    "random_start": Claim(
        "mean deviation, the start drawn {rows}; whole record p = {p_of_whole}. Drawn under {drawn_settings} of the "
        "{whole_settings} settings",
        "{reading} p = {p}, excluded at {limit:100×g} % by {excluded_by}",
        "; ",
        compared=("whole_p", "drawn_p"),
    ),
    # The noise.
    "uniform_noise": Claim(
        "smallest p of {records} records times {tests}: uniform {p_uniform:.2g}, mean {p_mean:.2g}, lag one "
        "{p_lag_one:.2g}; normal noise: at most {p_normal:.1g} uncorrected",
        compared="low",
    ),
    "no_backlash": Claim(
        "95th percentile of |A| over the smallest mean: {percentile:.2f} (95 % interval {low:.2f} to "
        "{high:.2f|no end below 72 records}); it is below {limit:.2g} in {below} of {noises} noise records; "
        "mean |A| {mean_rps:.3f}, largest {largest_rps:.3f} "
        "rps"
    ),
    "turns_reduce_noise": Claim(
        "error with {many} turns over that with {few} at three backlashes: {rows} (each within a factor {factor:.2f}, "
        "{noises} noises)",
        "{ratio:.2f}",
    ),
    "code_and_data_public": Claim(
        "of {files} public files {logs} are logs of the bench or of the robots", compared="logs"
    ),
    # The joint and its encoder.
    "impacts_at_phase_start": Claim(
        "{first:100×.0f} to {last:100×.0f} % of the phase has passed at the impact", compared="high"
    ),
    "depends_on_joint": Claim(
        "a stiffness a fifth lower changes the settled peak by {percent:.2g} %", compared="percent"
    ),
    "friction_disregarded": Claim(
        "on simulated logs frictions of {least:100×.2g} to {most:100×.2g} % of gravity change A by "
        "{low:.1f} to {high:.0f} %; the friction of the test's joint is not published"
    ),
    "bits_suffice": Claim(
        "{bits} bits change A by up to {change_rps:.2g} rps; the fewest tried that suffice: {fewest}",
        compared="change_rps",
    ),
    "discontinuities_destabilise": Claim(
        "largest error of the settled peak: {rows}; stability was not measured",
        "{model} {error}",
        compared=("alone", "most"),
    ),
    # The search.
    "cma_beats_swarms": Claim(
        "rates of the best basin: CMA-ES {rate:.2f}, {rows}",
        "{swarm} {rate:.2f} (p {p_cma_better:.1g})",
        compared=("p_better", "p_worse"),
    ),
    "classical_cannot": Claim("best basin found: {rows}", "{method} {found} of {runs}"),
    "classical_prepared": Claim("best basin found: {rows}", "{method} {found} of {runs}"),
    "little_tuning": Claim(
        "rate of the best basin, {rows}", "{method}: {rate:.2f} ({rate_low:.2f} to {rate_high:.2f})"
    ),
}


# ------------------------------------------------------------------------------------------ numbers to words


class _Scaling(string.Formatter):
    """Writes a number times what stands before the sign × of its format, and if it is none what stands after |."""

    def format_field(self, value: Any, format_spec: str) -> str:
        form, _, instead = format_spec.partition("|")
        if instead and not np.isfinite(value):
            return instead
        factor, _, form = form.rpartition("×")
        return format(float(factor) * value if factor else value, form)


def write_words(claim: str, numbers: Numbers) -> str:
    """Write what was measured of a claim."""
    write, form = _Scaling().format, CLAIMS[claim]
    of_rows = DataFrame(numbers.get("rows", ())).to_dict("records")
    rows = form.between.join(write(form.row, **of_row) for of_row in of_rows)
    return write(form.words, **{**numbers, "rows": rows})


def write_all(measured: Mapping[str, Numbers]) -> dict[str, Measured]:
    """What the rule of each claim compares, and the words, as `workbook.verdict` takes them."""
    written: dict[str, Measured] = {}
    for claim, numbers in measured.items():
        compared: Any = [float(numbers[name]) for name in np.ravel(CLAIMS[claim].compared)]
        written[claim] = compared, write_words(claim, numbers)
    return written


def find_ends(numbers: Collection[float]) -> dict[str, float]:
    """The smallest and the largest of some numbers, by the names that most claims compare."""
    return {"low": min(numbers), "high": max(numbers)}


def span(numbers: Series, form: str) -> str:
    """Write the first and the last of some numbers: "0.1 to 0.3"; once, where they look alike."""
    return " to ".join(dict.fromkeys(format(number, form) for number in numbers))


def margin(claim: str, compared: Any, criteria: Criteria = None) -> tuple[float, float]:
    """Ends of what was measured over the claim's limit, turned so that below 1 it holds and above 1 it does not."""
    limit = published.criterion(claim, criteria)
    rule = published.table("claims").loc[claim, "rule"]
    numbers = np.ravel(compared).astype(float)
    with np.errstate(divide="ignore"):
        if rule == "rounds to":
            ends = np.abs(numbers - limit) / published.half_last_digit(str(limit))
        elif rule == "p below":  # p of the claim, and of its opposite
            ends = np.array([numbers[0] / limit, limit / numbers[1]])
        elif "above" in rule or rule == "at least":
            ends = limit / numbers
        else:
            ends = numbers / limit
    return float(ends.min()), float(ends.max())


# ------------------------------------------------------------------------------------------ the disturbance


def half_turns(record: Recording) -> FloatArray:
    """Cut a record's speed less the commanded one [rps] into half turns, shape (half turns, samples)."""
    half = round(record.turn_period_s / 2 / record.sample_s)
    disturbance = record.v - record.commanded_speed_rps  # equation 11
    return disturbance[: disturbance.size // half * half].reshape(-1, half)


def root_mean_square(numbers: FloatArray, axis: int | None = None) -> Any:
    """Root of the mean square, of all or along an axis."""
    return np.sqrt(np.mean(np.square(numbers), axis=axis))


def measure_records(records: Mapping[float, Recording]) -> DataFrame:
    """Measure noise-free records by backlash [rad], a row each, without the first turn but for `rms_spread_whole`.

    Columns: `peak_rps` and `rms_rps` of the disturbance; `alternates`, whether the largest excursion changes its sign
    from every half turn to the next; `mismatch`, the RMS difference from itself, inverted and half a turn later, over
    the SD; `rms_spread`, the largest RMS of a half turn over the smallest, less 1.
    """
    rows = []
    for delta, record in sorted(records.items()):
        halves = half_turns(record)
        settled = halves[2:]
        is_upward = settled.max(axis=1) > -settled.min(axis=1)  # the largest excursion
        rms = root_mean_square(halves, axis=1)
        row = {
            "delta_rad": delta,
            "peak_rps": settled.max(),
            "rms_rps": root_mean_square(settled),
            "alternates": np.diff(is_upward).all(),
            "mismatch": root_mean_square(settled[1:] + settled[:-1]) / settled.std(),
            "rms_spread": rms[2:].max() / rms[2:].min() - 1,
            "rms_spread_whole": rms.max() / rms.min() - 1,
        }
        rows.append(row)
    return DataFrame(rows)


def measure_disturbance(records: DataFrame) -> dict[str, Numbers]:
    """Two impacts a turn, half a turn apart, of one amplitude that grows with the backlash: from `measure_records`."""
    steps = [
        ("peak of the samples", records["peak_rps"].diff().min()),
        ("RMS", records["rms_rps"].diff().min()),
        ("printed A", printed_rows()["theoretical"].diff().min()),
    ]
    rows = DataFrame(steps, columns=["name", "step_rps"])
    alternates = records["alternates"]
    return {
        "two_impacts": {
            "share": alternates.mean(),
            "alternating": alternates.sum(),
            "records": len(records),
        },
        "half_turn": find_ends(records["mismatch"]),
        "amplitude_grows": {**find_ends(rows["step_rps"]), "rows": rows},
        "same_amplitude": {
            "settled": records["rms_spread"].max(),
            "whole": records["rms_spread_whole"].max(),
        },
    }


# ------------------------------------------------------------------------------------------ the dead zone

# Sharpness of the edge [1/rad]: the smallest that the records allow (notebook 3), and one that they can't tell from it.
SHARP_EDGES = ("1e5", "1e6")


def measure_dead_zone(joint: Joint) -> dict[str, Numbers]:
    """What equations 8 and 9 leave in the gap, at Table 2's ten backlashes and `SHARP_EDGES`."""
    rows = []
    for alpha, delta in product(SHARP_EDGES, printed_rows()["delta_rad"]):
        sharp = joint._replace(alpha=float(alpha), clamped=False)
        before, after = (tau_l(side * 1e-15, 0.0, delta, side, sharp) for side in (-1, 1))
        at_edge, in_middle = (
            K_BL(gap, delta, joint.K_s, sharp.alpha) / joint.K_s for gap in (delta, 0.0)
        )
        rows.append((alpha, at_edge, in_middle, before - after))
    gaps = DataFrame(rows, columns=["alpha", "at_edge", "in_middle", "jump_nm"])
    by_alpha = gaps.groupby("alpha")["in_middle"]
    return {
        "stiffness_zero_inside": {
            **find_ends(gaps["in_middle"]),
            "at_edge": gaps["at_edge"].min(),
            "rows": by_alpha.agg(low="min", high="max").reset_index(),
        },
        "no_discontinuity": find_ends(gaps["jump_nm"]),
    }


# ------------------------------------------------------------------------------------------ equation 10, encoder


def measure_equation_10() -> dict[str, Numbers]:
    """What follows from equation 10 and Table 2 as printed, and the encoder's step."""
    rows = printed_rows()
    A_rps = np.linspace(0, rows["theoretical"].max(), 1000)
    by_equation = equation_10(rows["theoretical"].to_numpy())
    small, large = rows.iloc[[0, -1]].to_dict("records")
    return {
        "monotone": {
            "slope": np.gradient(equation_10(A_rps), A_rps).min(),
            "miss_rad": np.abs(by_equation - rows["delta_rad"]).max(),
        },
        "encoder_step": {"step_rad": encoder_step_rad()},
        "error_rad_small": small,
        "error_rad_large": large
        | {"share": large["error_rad"] / published.criterion("error_rad_large")},
    }


# ------------------------------------------------------------------------------------------ Table 2

OF_TABLE2 = (
    "error_below_10",
    "error_below_10_method",
    "quality_decreases",
    "local_minima",
    "noise_proportional",
)


def measure_table2(realisations: DataFrame) -> dict[str, Numbers]:
    """The errors of Table 2 as printed and of our tables with the whole record, and their searches.

    Parameters
    ----------
    realisations : DataFrame
        Of `realisations.read_realisations`.
    """
    names = [settings.name for settings in SETTINGS]
    whole = realisations[realisations["protocol"].isin(names) & (realisations["row"] <= 10)]
    means = whole.pivot(index=["protocol", "realisation"], columns="row", values="mean_A_rps")
    return {
        "error_below_10": measure_printed_errors(),
        "error_below_10_method": measure_our_errors(means),
        "quality_decreases": measure_quality(means),
        "local_minima": measure_local_minima(whole),
        "noise_proportional": measure_noise_proportional(),
    }


def measure_printed_errors() -> Numbers:
    """The largest relative error of the ten printed means."""
    errors = printed_rows()["error_percent"]
    return {"percent": errors.max(), "row": errors.idxmax()}


def measure_our_errors(means: DataFrame) -> Numbers:
    """The share of our tables that have an error above the paper's 10 %, from means [rps], a row a table."""
    limit = published.criterion("error_below_10")
    above = relative_error_percent(means, printed_rows()["theoretical"]) > limit
    worst = above.mean().nlargest(2)
    of_tables = above.any(axis=1)
    return {
        **find_ends(of_tables.groupby("protocol").mean()),
        "share": of_tables.mean(),
        "tables": len(means),
        "limit": limit,
        "rows": worst.rename("share").reset_index(),
        "public": above.drop(columns=1).any(axis=1).mean(),
    }


END_ROWS = 3  # at either end of Table 2


def measure_quality(means: DataFrame) -> Numbers:
    """The share of our tables in which a later row errs more in rad than an earlier one, from means [rps].

    `means` has a row a table. Each of the last three rows is compared with each of the first three.
    """
    rows = printed_rows()
    errors = np.abs(equation_10(means) - rows["delta_rad"].to_numpy())
    percent = relative_error_percent(means, rows["theoretical"]).to_numpy()
    pairs = Series(
        {
            (earlier, later): np.mean(errors[:, later - 1] > errors[:, earlier - 1])
            for earlier, later in product(rows.index[:END_ROWS], rows.index[-END_ROWS:])
        }
    )
    ends = pairs.loc[[pairs.idxmin(), pairs.idxmax()]].rename_axis(["earlier", "later"])
    return {
        **find_ends(pairs),
        "tables": len(means),
        "rows": ends.reset_index(name="share"),
        "first": rows.index[0],
        "last": rows.index[-1],
        "in_percent": np.mean(percent[:, -1] > percent[:, 0]),
    }


def measure_local_minima(realisations: DataFrame) -> Numbers:
    """The share of runs in the best basin, by the population of the search, and of the stored runs."""
    population = {settings.name: settings.population for settings in SETTINGS}
    sizes = realisations["protocol"].map(population).rename("population")
    shares = realisations.groupby(sizes)["best_basin_share"].mean()
    ends = published.table("authors_notebook_runs")["final_rmse_rps"]
    in_best = basin_labels(ends.to_numpy()) == 1
    return {
        **find_ends([*shares, in_best.mean()]),
        "stored_best": in_best.sum(),
        "stored": in_best.size,
        "rows": shares.rename("share").reset_index(),
    }


def measure_noise_proportional() -> Numbers:
    """How far the ratio of Table 2's printed noise to its theoretical A varies."""
    rows = printed_rows()
    ratio = rows["noise"] / rows["theoretical"]
    return {"first": ratio.iloc[0], "last": ratio.iloc[-1], "factor": ratio.max() / ratio.min()}


# ------------------------------------------------------------------------------------------ noise, public files


def measure_uniform_noise(tests: DataFrame) -> Numbers:
    """The smallest corrected p of a law that is uniform, white and of zero mean, from `experiments.noise_tests`."""
    p = tests[["p_uniform", "p_mean", "p_lag_one"]]
    corrected = (p.min() * p.size).clip(upper=1.0)
    return corrected.to_dict() | {
        "low": corrected.min(),
        "records": len(p),
        "tests": p.size,
        "p_normal": tests["p_normal"].max(),
    }


def measure_no_backlash(amplitude_rps: FloatArray, smallest_A_rps: float) -> Numbers:
    """The 95th percentile of |A| in noise alone, as a share of the smallest A with backlash."""
    share = amplitude_rps / smallest_A_rps
    # The order statistics that hold the percentile: nan where there are too few for 95 % confidence.
    low, high = stats.quantile_test(share, p=0.95).confidence_interval(0.95)
    limit = published.criterion("no_backlash")
    return {
        "percentile": np.quantile(share, 0.95),
        "low": low,
        "high": high,
        "limit": limit,
        "below": (share < limit).sum(),
        "noises": share.size,
        "mean_rps": amplitude_rps.mean(),
        "largest_rps": amplitude_rps.max(),
    }


def measure_turns(errors: DataFrame) -> Numbers:
    """The RMS error of the longest records over that of the shortest, from `experiments.measure_error`."""
    squares = (errors["error_rps"] ** 2).groupby([errors["delta_rad"], errors["turns"]])
    rms = np.sqrt(squares.mean()).unstack()
    few, many = rms.columns
    ratios = rms[many] / rms[few]
    noises = squares.size().min()
    # F's own quantiles at 0.025 and 0.975 are inverses.
    factor = np.sqrt(stats.f.ppf(0.975, noises, noises))
    return {
        "low": ratios.max() / factor,
        "high": ratios.max() * factor,
        "few": few,
        "many": many,
        "factor": factor,
        "noises": noises,
        "rows": ratios.to_frame("ratio"),
    }


def measure_public_files() -> dict[str, Numbers]:
    """How many of the authors' public files are logs of the bench or of the robots."""
    files = [path.lower() for path in authors_checksums()]
    logs = sum("bench" in path or "robot" in path for path in files)
    return {"code_and_data_public": {"files": len(files), "logs": logs}}


# ------------------------------------------------------------------------------------------ the joint, its encoder


def measure_impacts(phases: DataFrame) -> Numbers:
    """The largest share of its phase that has passed at an impact, from `experiments.impact_phases`."""
    passed = phases["share_passed"]
    # What comes before its phase comes at the end of the one before.
    return {"high": (passed % 1).max(), "first": passed.min(), "last": passed.max()}


def measure_friction(study: DataFrame) -> Numbers:
    """The smallest and the largest change of A by friction, from `experiments.friction_study`."""
    rubbed = study[study["friction"] > 0]
    return {
        **find_ends(rubbed["change_percent"].abs()),
        "least": rubbed["friction"].min(),
        "most": rubbed["friction"].max(),
    }


def measure_bits(study: DataFrame, bits: int) -> Numbers:
    """The largest change of A by an encoder of so many bits, from `experiments.bits_study`."""
    largest = study.groupby("bits")["change_rps"].max()
    at_most = largest[::-1].cummax()  # by so many bits or more
    enough = at_most.index[at_most < published.criterion("bits_suffice")]
    return {"bits": bits, "change_rps": largest[bits], "fewest": min(enough, default="none")}


def measure_discontinuities(study: DataFrame) -> Numbers:
    """How much a torque that steps spoils a simulation, and it alone, from `edge.stepping_torque_study`.

    An error below the limit refutes the claim only if the smooth torque's is no smaller: stability,
    other systems and other solvers were not tried.
    """
    errors = study.pivot(index=["delta_rad", "step_s"], columns="model", values="error")
    by_case = errors.abs().fillna(np.inf)
    sound = by_case["modified"] <= published.criterion("discontinuities_destabilise")
    largest = by_case.max()
    most = np.inf if largest["stepping"] > largest["modified"] else largest["stepping"]
    rows = [
        {"model": model, "error": "diverges" if np.isinf(error) else f"{100 * error:.2g} %"}
        for model, error in largest.items()
    ]
    return {"alone": by_case.loc[sound, "stepping"].max(), "most": most, "rows": rows}


# ------------------------------------------------------------------------------------------ the search


def measure_swarms(compared: DataFrame) -> Numbers:
    """P that CMA-ES beats every swarm, and that one beats it, from `optimizers.against_swarms`."""
    return {
        "p_better": len(compared) * compared["p_cma_better"].max(),
        "p_worse": len(compared) * compared["p_swarm_better"].min(),
        "rate": compared["rate_cma"].iloc[0],
        "rows": compared,
    }


def measure_classical(table: DataFrame, kind: str) -> Numbers:
    """How often classical methods of a kind, "classical" or "prepared", succeed, from `optimizers.success_table`."""
    classical = table[table["kind"] == kind]
    low, high = classical[["rate_low", "rate_high"]].max()
    return {"low": low, "high": high, "rows": classical}


def measure_tuning(table: DataFrame) -> Numbers:
    """How often CMA-ES succeeds with its own settings, from `optimizers.success_table`."""
    untuned = table[table["method"].str.startswith("CMA-ES, its own population")]
    ends = {"low": untuned["rate_low"].min(), "high": untuned["rate_high"].max()}
    return ends | {"rows": untuned}
