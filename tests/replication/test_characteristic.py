"""Equation 10 and what follows from its printed points."""

import numpy as np
import pytest

from replication import characteristic, published


def test_the_known_amplitude_is_interpolated_in_table_2():
    levels = characteristic.printed_levels_rad()
    np.testing.assert_allclose(levels, np.arange(3e-4, 22e-4, 2e-4), rtol=1e-12)
    # Table 3's are those of 9e-4, 10e-4 and 11e-4 rad.
    ours = [characteristic.known_amplitude_rps(delta) for delta in (9e-4, 10e-4, 11e-4)]
    np.testing.assert_allclose(ours, published.column("Table 3", "known"), atol=6e-5)


def test_printed_relative_errors_follow_from_the_printed_means_but_for_rounding():
    table = characteristic.table_arithmetic()
    off = (table["relative_error_percent"] - table["printed_percent"]).abs()
    assert len(table) == 13
    assert (off <= table["rounding_percent"]).all()
    # Of 0.5e-4 rps in the mean and 0.5e-2 in the error.
    assert table["rounding_percent"].max() == pytest.approx(100 * 0.5e-4 / 0.2769 + 0.5e-2)
