import pytest
from hypothesis import given
from hypothesis import strategies as st

from replication import characteristic


@given(st.floats(1e-3, 1.2))
def test_amplitude_and_backlash_are_inverse_over_the_printed_range(amplitude):
    equation = characteristic.equation_10()
    assert equation.amplitude_rps(equation.backlash_rad(amplitude)) == pytest.approx(
        amplitude, abs=1e-9
    )


def test_a_backlash_below_the_constant_has_no_amplitude():
    with pytest.raises(ValueError, match="no positive amplitude"):
        characteristic.equation_10().amplitude_rps(1e-5)
