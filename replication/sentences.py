"""The paper's sentences that its notebooks decide: each is measured, and held against its rule in `claims.csv`.

A function measures the sentences of one subject; `published.decide_all` then says which hold.
"""

from collections.abc import Mapping
from itertools import product

import numpy as np
import pandas as pd

from replication import published, table2
from replication.characteristic import equation_10, printed_levels_rad
from replication.joint import K_BL, Joint, tau_l
from replication.published import Measured
from replication.records import Recording, authors_checksums
from replication.signature import FloatArray

MRAD = 1e3  # per rad
# Sharpness of the edge [1/rad]: the smallest that the records allow (notebook 3), and one that they can't tell from it.
SHARP_EDGES = (1e5, 1e6)
# What the functions below decide, whose limits a notebook lets one change.
OF_EQUATION_10 = ("monotone", "encoder_step", "error_rad_small", "error_rad_large")
OF_TABLE2 = (
    "error_below_10",
    "error_below_10_method",
    "quality_decreases",
    "local_minima",
    "noise_proportional",
)


def printed_rows() -> pd.DataFrame:
    """Table 2's ten rows as printed, with their backlash [rad] and the error [rad] of the mean by equation 10."""
    columns = ("theoretical", "noise", "mean")
    rows = pd.DataFrame({name: published.column("Table 2", name)[:10] for name in columns})
    rows["delta_rad"] = printed_levels_rad()
    rows["error_rad"] = np.abs(equation_10().backlash_rad(rows["mean"]) - rows["delta_rad"])
    return rows.set_index(pd.RangeIndex(1, 11, name="row"))


# ------------------------------------------------------------------------------------------------ the disturbance


def measure_records(records: Mapping[float, Recording]) -> pd.DataFrame:
    """Measure noise-free records by backlash [rad], a row each, without the first turn but for `rms_spread_whole`.

    Columns: `peak_rps` and `rms_rps` of the disturbance; `alternates`, whether the largest excursion changes its sign
    from every half turn to the next; `mismatch`, the RMS difference from itself, inverted and half a turn later, over
    the SD; `rms_spread`, the largest RMS of a half turn over the smallest, less 1.
    """
    rows = []
    for delta in sorted(records):
        halves = half_turns(records[delta])
        settled = halves[2:]
        largest = settled[np.arange(len(settled)), np.abs(settled).argmax(axis=1)]
        rms = np.sqrt((halves**2).mean(axis=1))
        row = {
            "delta_rad": delta,
            "peak_rps": settled.max(),
            "rms_rps": np.sqrt((settled**2).mean()),
            "alternates": (np.sign(largest[1:]) == -np.sign(largest[:-1])).all(),
            "mismatch": np.sqrt(np.mean((settled[1:] + settled[:-1]) ** 2)) / settled.std(),
            "rms_spread": rms[2:].max() / rms[2:].min() - 1,
            "rms_spread_whole": rms.max() / rms.min() - 1,
        }
        rows.append(row)
    return pd.DataFrame(rows)


def measure_disturbance(measured: pd.DataFrame) -> dict[str, Measured]:
    """Two impacts a turn, half a turn apart, of one amplitude that grows with the backlash: from `measure_records`."""
    steps = {
        "peak of the samples": measured["peak_rps"].diff().min(),
        "RMS": measured["rms_rps"].diff().min(),
        "printed A": np.diff(published.column("Table 2", "theoretical")[:10]).min(),
    }
    smallest = ", ".join(f"{name} {step:.3f}" for name, step in steps.items())
    alternates, mismatch = measured["alternates"], measured["mismatch"]
    spread, whole = measured["rms_spread"].max(), measured["rms_spread_whole"].max()
    ends = min(steps.values()), max(steps.values())
    return {
        "two_impacts": (
            float(alternates.all()),
            f"in {alternates.sum()} of {len(measured)} records the largest excursion changes its sign from every "
            "settled half turn to the next",
        ),
        "half_turn": (
            mismatch.max(),
            f"inverted and half a turn later a record differs from itself by {100 * mismatch.min():.1f} to "
            f"{100 * mismatch.max():.1f} % of its SD",
        ),
        "amplitude_grows": (ends, f"smallest increase from level to level [rps]: {smallest}"),
        "same_amplitude": (
            spread,
            f"settled half turns differ by up to {100 * spread:.1f} % in RMS, with the first turn by up to "
            f"{100 * whole:.1f} %",
        ),
    }


def half_turns(record: Recording) -> FloatArray:
    """Cut a record's speed less the commanded one [rps] into half turns, shape (half turns, samples)."""
    half = round(record.turn_period_s / 2 / record.sample_s)
    disturbance = record.v - record.commanded_speed_rps  # equation 11
    return disturbance[: disturbance.size // half * half].reshape(-1, half)


# --------------------------------------------------------------------------------------------------- the dead zone


def measure_dead_zone(joint: Joint) -> dict[str, Measured]:
    """What equations 8 and 9 leave in the gap, at Table 2's ten backlashes and `SHARP_EDGES`."""
    deltas = printed_levels_rad()
    at_edge, middle, jumps = [], [], []
    for alpha, delta in product(SHARP_EDGES, deltas):
        sharp = joint._replace(alpha=alpha, clamped=False)
        at_edge.append(K_BL(delta, delta, joint.K_s, alpha) / joint.K_s)
        middle.append(K_BL(0.0, delta, joint.K_s, alpha) / joint.K_s)
        before, after = (tau_l(side * 1e-15, 0.0, delta, side, sharp) for side in (-1, 1))
        jumps.append(before - after)
    middle = middle[: deltas.size]
    return {
        "stiffness_zero_inside": (
            min(at_edge),
            f"{100 * min(at_edge):.0f} % of K_s at the edge; in mid-gap {100 * max(middle):.1f} % at "
            f"{MRAD * deltas[0]:.1f} mrad to {100 * min(middle):.1f} % at {MRAD * deltas[-1]:.1f} mrad, at alpha = "
            f"{SHARP_EDGES[0]:.0e} per rad".replace("e+0", "e"),
        ),
        "no_discontinuity": (
            min(jumps),
            f"the torque jumps at zero by {min(jumps):.2g} to {max(jumps):.2g} N m",
        ),
    }


# --------------------------------------------------------------------------------------------- equation 10, encoder


def measure_equation_10() -> dict[str, Measured]:
    """What follows from equation 10 and Table 2 as printed, and the encoder's step."""
    rows = printed_rows()
    A_rps = np.linspace(0, rows["theoretical"].max(), 1000)
    slope = np.gradient(equation_10().backlash_rad(A_rps), A_rps).min()
    misses = np.abs(equation_10().backlash_rad(rows["theoretical"]) - rows["delta_rad"]).max()
    step = 2 * np.pi / 2 ** published.value("text.encoder_bits")
    error, worst = rows["error_rad"], rows["error_rad"].idxmax()
    return {
        "monotone": (
            slope,
            f"the smallest slope from 0 rps on is {MRAD * slope:.2g} mrad per rps; it misses Table 2's points by at "
            f"most {MRAD * misses:.2g} mrad",
        ),
        "encoder_step": (step, f"one step of the encoder is {MRAD * step:.3g} mrad"),
        "error_rad_small": (
            error.iloc[0],
            f"{error.iloc[0]:.2g} rad at {MRAD * rows['delta_rad'].iloc[0]:.1f} mrad",
        ),
        "error_rad_large": (
            error.max(),
            f"the largest error is {error.max():.2g} rad, at {MRAD * rows['delta_rad'].loc[worst]:.1f} mrad",
        ),
    }


# --------------------------------------------------------------------------------------------------------- Table 2


def measure_table2(realisations: pd.DataFrame) -> dict[str, Measured]:
    """The errors of Table 2 as printed and of our tables with the whole record, and their searches.

    Parameters
    ----------
    realisations : DataFrame
        Of `table2.read_realisations`.
    """
    names = [settings.name for settings in table2.SETTINGS]
    whole = realisations[realisations["protocol"].isin(names) & (realisations["row"] <= 10)]
    means = whole.pivot(index=["protocol", "realisation"], columns="row", values="mean_A_rps")
    return {
        "error_below_10": measure_printed_errors(),
        "error_below_10_method": measure_our_errors(means),
        "quality_decreases": measure_quality(means),
        "local_minima": measure_local_minima(whole),
        "noise_proportional": measure_noise_proportional(),
    }


def measure_printed_errors() -> Measured:
    """The largest error [%] of the ten printed means."""
    rows = printed_rows()
    errors = 100 * np.abs(rows["mean"] / rows["theoretical"] - 1)
    return errors.max(), (
        f"the largest of the ten printed errors is {errors.max():.2f} %, in row {errors.idxmax()}"
    )


def measure_our_errors(means: pd.DataFrame) -> Measured:
    """The share of our tables that have an error above the paper's 10 %, from means [rps], a row a table."""
    limit = published.criterion("error_below_10")
    over = 100 * np.abs(means / printed_rows()["theoretical"] - 1) > limit
    by_setting = over.any(axis=1).groupby("protocol").mean()
    low, high = by_setting.min(), by_setting.max()
    share = over.mean()
    first, second = share.nlargest(2).index
    public = over.drop(columns=1).any(axis=1).mean()
    return (low, high), (
        f"{100 * over.any(axis=1).mean():.0f} % of our {len(means)} tables have an error above {limit:g} % "
        f"({100 * low:.0f} to {100 * high:.0f} % by setting); row {first} in {100 * share[first]:.0f} %, row {second} "
        f"in {100 * share[second]:.0f} %; without row 1, whose record is simulated, {100 * public:.0f} %"
    )


def measure_quality(means: pd.DataFrame) -> Measured:
    """The share of our tables whose last row errs more in rad than the first, from means [rps], a row a table."""
    rows = printed_rows()
    errors = equation_10().backlash_rad(means) - rows["delta_rad"].to_numpy()
    rms = 1e6 * np.sqrt(np.mean(errors**2, axis=0))
    relative = (means / rows["theoretical"] - 1).abs()
    percent = np.sqrt((relative**2).mean())
    worse = pd.Series(np.abs(errors[:, -1]) > np.abs(errors[:, 0]), means.index)
    worse_in_percent = (relative.iloc[:, -1] > relative.iloc[:, 0]).mean()
    by_setting = worse.groupby("protocol").mean()
    low, high = by_setting.min(), by_setting.max()
    in_rad, in_percent = (
        rows["delta_rad"].corr(pd.Series(x, rows.index), "kendall") for x in (rms, percent)
    )
    return (low, high), (
        f"in rad the last row errs more than the first in {100 * worse.mean():.0f} % of our {len(means)} tables "
        f"({100 * low:.0f} to {100 * high:.0f} % by setting; RMS {rms[0]:.0f} and {rms[-1]:.0f} µrad), in percent in "
        f"{100 * worse_in_percent:.0f} %; row by row the "
        f"rank correlation is {in_rad:+.2f}, in percent {in_percent:+.2f}"
    )


def measure_local_minima(realisations: pd.DataFrame) -> Measured:
    """The share of runs in the best basin, by the population of the search, and of the stored runs."""
    population = {settings.name: settings.population for settings in table2.SETTINGS}
    sizes = realisations["protocol"].map(population)
    by_population = realisations["best_basin_share"].groupby(sizes).mean()
    ends = published.table("authors_notebook_runs")["final_rmse_rps"]
    stored = table2.basin_labels(ends.to_numpy()) == 1
    shares = [*by_population, stored.mean()]
    listed = ", ".join(f"{100 * share:.0f} % ({size})" for size, share in by_population.items())
    return (min(shares), max(shares)), (
        f"runs in the best basin by population: {listed}; {stored.sum()} of the authors' {stored.size} stored runs; "
        "the paper prints no population"
    )


def measure_noise_proportional() -> Measured:
    """How far the ratio of Table 2's printed noise to its theoretical A varies."""
    rows = printed_rows()
    ratio = rows["noise"] / rows["theoretical"]
    factor = ratio.max() / ratio.min()
    return factor, (
        f"noise over A falls from {ratio.iloc[0]:.2f} to {ratio.iloc[-1]:.3f}, a factor {factor:.2f}"
    )


# ------------------------------------------------------------------------------------------------ what is published


def measure_public_files() -> Measured:
    """How many of the authors' public files are logs of the bench or of the robots."""
    files = [path.lower() for path in authors_checksums()]
    logs = [path for path in files if "bench" in path or "robot" in path]
    return len(logs), (
        f"of {len(files)} public files {len(logs)} are logs of the bench or of the robots"
    )
