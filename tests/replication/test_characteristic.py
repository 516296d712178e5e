"""Equation 10 and what follows from its printed points."""

import numpy as np
import pytest

from replication import characteristic, published


def test_equation_10_gives_the_printed_levels_with_A_in_rpm():
    theoretical = published.column("Table 2", "theoretical")[:10]
    delta = characteristic.equation_10().backlash_rad(theoretical)
    np.testing.assert_allclose(delta, characteristic.printed_levels_rad(), atol=1.8e-5)


def test_the_amplitude_of_a_backlash_inverts_the_characteristic_and_an_impossible_one_is_refused():
    equation = characteristic.equation_10()
    for A in (0.3, 0.7, 1.1):
        assert equation.amplitude_rps(float(equation.backlash_rad(A))) == pytest.approx(A)
    with pytest.raises(ValueError, match="no positive amplitude"):
        equation.amplitude_rps(0.1)


def test_printed_relative_errors_follow_from_the_printed_means_but_for_rounding():
    table = characteristic.table_arithmetic()
    off = (table["relative_error_percent"] - table["printed_percent"]).abs()
    assert len(table) == 13
    assert (off <= table["rounding_percent"] * 1.001).sum() >= 12
