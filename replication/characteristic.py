"""The virtual sensor's static characteristic, equation 10: from amplitude A to backlash delta."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.polynomial import Polynomial

from replication import published
from replication.records import RPM_PER_RPS
from replication.signature import FloatArray


def first_rise(coefficients: Sequence[float] | FloatArray, level: float) -> float | None:
    """Smallest positive argument at which a polynomial rises through a level.

    None if it never does.
    """
    polynomial = Polynomial(coefficients)
    roots = (polynomial - level).roots()
    real = roots[np.abs(roots.imag) < 1e-9].real
    rising = real[(real > 0) & (polynomial.deriv()(real) > 0)]
    return float(rising.min()) if rising.size else None


@dataclass(frozen=True)
class Characteristic:
    """Polynomial delta(A), equation 10's form."""

    coefficients: FloatArray  # [rad/rpm^k], shape (degree + 1,), from the constant upwards

    def backlash_rad(self, amplitude_rps: FloatArray | float) -> FloatArray | float:
        """Backlash delta [rad] of an amplitude A [rps]; the polynomial itself takes rpm."""
        return Polynomial(self.coefficients)(RPM_PER_RPS * np.asarray(amplitude_rps))

    def amplitude_rps(self, delta_rad: float) -> float:
        """Smallest positive amplitude A [rps] at which delta(A) rises through a backlash.

        Raises
        ------
        ValueError
            No positive amplitude gives it.
        """
        amplitude_rpm = first_rise(self.coefficients, delta_rad)
        if amplitude_rpm is None:
            raise ValueError(f"backlash {delta_rad:g} rad: no positive amplitude gives it")
        return amplitude_rpm / RPM_PER_RPS


def equation_10() -> Characteristic:
    """Equation 10 with its printed coefficients."""
    return Characteristic(1e-6 * np.array([published.value(f"equation10.A{k}") for k in range(4)]))


def printed_levels_rad() -> FloatArray:
    """Backlash of Table 2's ten rows [rad], from the range and step that the text prints."""
    first, step = published.value("text.delta_min"), published.value("text.delta_step")
    return first + step * np.arange(published.value("text.levels"))


def known_amplitude_rps(delta_rad: float) -> float:
    """Theoretical A [rps] of a backlash, interpolated in Table 2, as Table 3's known A are."""
    levels = printed_levels_rad()
    theoretical = published.column("Table 2", "theoretical")[: levels.size]
    return float(np.interp(delta_rad, levels, theoretical))


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
            "relative_error_percent": 100 * abs(values["mean"] - true) / true,
            "rounding_percent": 100 * digits["mean"] / true + digits["relative_error"],
        }
        tables.append(pd.DataFrame(table).reset_index())
    return pd.concat(tables, ignore_index=True)
