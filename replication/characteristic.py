"""The virtual sensor's static characteristic, equation 10, and what follows from the printed numbers by it."""

from typing import Any

import numpy as np
import pandas as pd
from numpy.polynomial import Polynomial

from replication import published
from replication.records import RPM_PER_RPS
from replication.signature import TURN, FloatArray

DEGREE = 3


def printed_coefficients() -> FloatArray:
    """Coefficients of equation 10 [rad/rpm^k], shape (4,), from the constant upwards."""
    printed = [published.value(f"equation10.A{power}") for power in range(DEGREE + 1)]
    return 1e-6 * np.array(printed)


def equation_10(amplitude_rps: FloatArray | float) -> FloatArray:
    """Equation 10: delta, half the gap [rad], of an amplitude A [rps]; the polynomial itself takes rpm (erratum E1)."""
    A = RPM_PER_RPS * np.asarray(amplitude_rps)
    return Polynomial(printed_coefficients())(A)  # equation 10


# ------------------------------------------------------------------------- what follows from printed numbers


def printed_levels_rad() -> FloatArray:
    """Backlash of Table 2's ten rows [rad], from the range and step that the text prints."""
    first, step = published.value("text.delta_min"), published.value("text.delta_step")
    return first + step * np.arange(published.value("text.levels"))


def encoder_step_rad() -> float:
    """Step of the encoder [rad], from the number of bits that the text prints."""
    return float(TURN / 2 ** published.value("text.encoder_bits"))


def relative_error_percent(mean: Any, true: Any) -> Any:
    """Relative error of means of A, as Tables 2 and 3 have it [%]: an array, a series or a frame, as `mean` is."""
    return 100 * np.abs(mean / true - 1)


def printed_rows() -> pd.DataFrame:
    """Table 2's ten rows with backlash, by their number, as printed.

    Columns `delta_rad, theoretical, noise, mean` [rps], the relative error of the mean, `error_percent`, and its error
    by equation 10, `error_rad`.
    """
    delta = printed_levels_rad()
    columns = ("theoretical", "noise", "mean")
    rows = pd.DataFrame({name: published.column("Table 2", name)[: delta.size] for name in columns})
    rows.insert(0, "delta_rad", delta)
    rows["error_percent"] = relative_error_percent(rows["mean"], rows["theoretical"])
    rows["error_rad"] = np.abs(equation_10(rows["mean"]) - delta)
    return rows.set_index(pd.RangeIndex(1, delta.size + 1, name="row"))


def known_amplitude_rps(delta_rad: float) -> float:
    """Theoretical A [rps] of a backlash, interpolated in Table 2, as Table 3's known A are."""
    rows = printed_rows()
    return float(np.interp(delta_rad, rows["delta_rad"], rows["theoretical"]))


def table_arithmetic() -> pd.DataFrame:
    """Recompute the relative errors of Tables 2 and 3 from their printed means.

    `rounding_percent` is what the rounding of the printed mean and of the printed error leaves
    open.
    """
    tables = []
    for element, reference in (("Table 2", "theoretical"), ("Table 3", "known")):
        cells = published.cells(element).astype({"row": int})
        cells = cells.set_index(["element", "row", "column"])
        values = cells["value"].unstack().query(f"{reference} > 0")
        digits = cells["printed"].map(published.half_last_digit).unstack().loc[values.index]
        true = values[reference]
        table = {
            "printed_percent": values["relative_error"],
            "relative_error_percent": relative_error_percent(values["mean"], true),
            "rounding_percent": 100 * digits["mean"] / true + digits["relative_error"],
        }
        tables.append(pd.DataFrame(table).reset_index())
    return pd.concat(tables, ignore_index=True)


def numbers_of_the_text() -> dict[str, float]:
    """Compute numbers that the text says in passing, which follow from the tables and equation 10, by their names."""
    rows = printed_rows()
    levels = equation_10(rows["theoretical"].to_numpy())
    numbers = {
        "error_rad_small": rows["error_rad"].iloc[0],
        "error_rad_large": rows["error_rad"].iloc[-1],
        "levels": np.count_nonzero(published.column("Table 2", "theoretical")),
        "delta_min": levels[0],
        "delta_max": levels[-1],
        "delta_step": np.diff(levels).mean(),
        "encoder_step": encoder_step_rad(),
        "error_limit_percent": published.column("Table 2", "relative_error").max(),
        "figure11_signals": len(rows),
        "figure12_points": count_points(rows),
        "parameters": len(
            {*published.cells("Table 1")["row"]} - {"v_t", "T_d"}
        ),  # commanded (equation 11), half of T_f
    }
    return {name: float(number) for name, number in numbers.items()}


def count_points(rows: pd.DataFrame) -> int:
    """Count the `printed_rows`, from the first one, whose cubic has equation 10's printed coefficients; 0 if none."""
    printed = 1e6 * printed_coefficients()[::-1]
    rounding = published.half_last_digit(published.cells().at["equation10.A0", "printed"])
    for count in range(DEGREE + 2, len(rows) + 1):
        points = rows[:count]
        fitted = 1e6 * np.polyfit(RPM_PER_RPS * points["theoretical"], points["delta_rad"], DEGREE)
        if np.abs(fitted - printed).max() <= rounding:
            return count
    return 0
