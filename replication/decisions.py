"""Decisions on the paper's prose claims, and the cells that go with them: what notebooks and sensitivity judge.

A decision is a pair: whether the claim holds, and what was measured. `data/claims.csv` says how each is decided.
"""

import numpy as np
import pandas as pd

from replication import characteristic as sensor
from replication import inspection, published
from replication.datasets import Recording

Decision = tuple[bool, str]


def impacts(record: Recording) -> dict[str, Decision]:
    """Claims on the two impacts of a turn, on a clean record (notebook 1)."""
    mismatch = inspection.half_turn_mismatch(record)
    return {
        "two_impacts": (
            inspection.impacts_alternate(record),
            "record 12: the largest excursion changes its sign from each settled half turn to the next",
        ),
        "half_turn": (
            mismatch < 0.05,
            f"record 12, inverted and half a turn later, differs by {100 * mismatch:.1f} % of its SD",
        ),
    }


def simulator_agrees(validation: pd.DataFrame) -> Decision:
    """Claim on the simulator, from `simulations.validate` (notebook 4)."""
    nrmse = validation["nrmse"].dropna()
    return (
        bool(nrmse.max() < 0.065 and nrmse.mean() < 0.05),
        f"RMSE over SD: mean {100 * nrmse.mean():.2f} %, largest {100 * nrmse.max():.2f} % in {nrmse.size} records",
    )


def amplitude_grows(peaks: pd.DataFrame) -> Decision:
    """Claim on the growth of the disturbance, from `simulations.amplitudes` (notebook 5)."""
    amplitude = peaks["amplitude_rps"]
    growth = np.diff(amplitude)
    return (
        bool((growth > 0).all()),
        f"from {amplitude.iloc[0]:.3f} to {amplitude.iloc[-1]:.3f} rps over "
        f"{len(peaks)} levels, by steps of {growth.min():.3f} to {growth.max():.3f} rps",
    )


def equation10_cells(fitted: sensor.Characteristic) -> dict[str, float]:
    """Cells of equation 10, in their units, from a fitted cubic."""
    return {f"equation10.A{k}": 1e6 * fitted.coefficients[k] for k in range(4)} | {"equation10.rmse": fitted.rmse_rad}


def errors_of_printed_means(equation: sensor.Characteristic) -> pd.DataFrame:
    """What Table 2's printed means give for the backlash, through a characteristic.

    Returns
    -------
    DataFrame
        A row a level: `delta_rad, printed_mean_A_rps`; `error_of_A_rad`, the effect of the error in A alone;
        `error_rad`, against the level, with the characteristic's own misfit.
    """
    delta = sensor.printed_levels_rad()
    theoretical, mean = (published.column("Table 2", name)[: delta.size] for name in ("theoretical", "mean"))
    estimated = equation.backlash_rad(mean)
    return pd.DataFrame(
        {
            "delta_rad": delta,
            "printed_mean_A_rps": mean,
            "error_of_A_rad": estimated - equation.backlash_rad(theoretical),
            "error_rad": estimated - delta,
        }
    )


def error_cells(errors: pd.DataFrame) -> dict[str, float]:
    """Cells of the text on the errors in rad, from `errors_of_printed_means`."""
    error = errors["error_rad"].abs()
    return {"text.error_rad_small": error.iloc[0], "text.error_rad_large": error.max()}


def characteristic(equation: sensor.Characteristic, errors: pd.DataFrame) -> dict[str, Decision]:
    """Claims on equation 10 and on the errors in rad, from `errors_of_printed_means` (notebook 6)."""
    delta, error = errors["delta_rad"], errors["error_rad"].abs()
    last = published.column("Table 2", "theoretical").max()
    slope = np.diff(equation.backlash_rad(np.linspace(0, last, 1000)))
    small, large = published.value("text.error_rad_small"), published.value("text.error_rad_large")
    return {
        "error_rad_small": (bool(error.iloc[0] < small), f"{error.iloc[0]:.2g} rad at {delta[0]:.0e} rad"),
        "error_rad_large": (
            bool(error.max() <= large and error.idxmax() == error.size - 1),
            f"largest {error.max():.2g} rad, at {delta[error.idxmax()]:.1e} rad",
        ),
        "quality_decreases": (
            bool(error.iloc[5:].mean() > error.iloc[:5].mean()),
            f"mean error {error.iloc[:5].mean():.2g} rad in the first five rows, then {error.iloc[5:].mean():.2g} rad",
        ),
        "monotone": (bool((slope > 0).all()), "the derivative is positive over the range of the points"),
    }


def encoder_step(bits: float) -> tuple[float, Decision]:
    """Smallest angle that an encoder of so many bits tells [rad], and the claim on it (notebook 6)."""
    step = 2 * np.pi / 2**bits
    holds = abs(step - published.value("text.encoder_step")) <= published.tolerance("text.encoder_step")
    return step, (bool(holds), f"2 pi / 2^{bits:.0f} = {step:.3g} rad")


def error_below_10(table: pd.DataFrame) -> Decision:
    """Claim on Table 2's relative errors, from `experiments.table2` on the authors' records (notebook 8)."""
    theory = table["theoretical_A_rps"]
    largest = table["relative_error_percent"].max()
    largest_best = (100 * (table["best_A_rps"] - theory).abs() / theory).max()
    return (
        bool(largest < 10 and largest_best < 10),
        f"largest error of a row: mean of all runs {largest:.1f} %, best basin {largest_best:.1f} %",
    )


def no_backlash(noise_only_A_rps: float, smallest_row_A_rps: float) -> Decision:
    """Claim on the record without backlash: its mean A against the smallest row's (notebook 8)."""
    spurious = abs(noise_only_A_rps)
    return (
        bool(spurious < smallest_row_A_rps / 4),
        f"|mean A| on noise only {spurious:.4f} rps, smallest row {smallest_row_A_rps:.4f} rps",
    )


def uniform_noise(noise_law: pd.DataFrame) -> Decision:
    """Claim on the noise, from a row of `inspection.uniform_noise_test` a record (notebook 8)."""
    is_uniform = (noise_law["p_uniform"] > 0.01).all() and (noise_law["lag_one_correlation"].abs() < 0.07).all()
    return (
        bool(is_uniform),
        f"smallest p of the uniform law in nine records: {noise_law['p_uniform'].min():.2f}",
    )
