import pytest
from hypothesis import given
from hypothesis import strategies as st

from replication import characteristic, published


@given(st.floats(1e-3, 1.2))
def test_amplitude_and_backlash_are_inverse_over_the_printed_range(amplitude):
    equation = characteristic.equation_10()
    assert equation.amplitude_rps(equation.backlash_rad(amplitude)) == pytest.approx(
        amplitude, abs=1e-9
    )


def test_a_backlash_below_the_constant_has_no_amplitude():
    with pytest.raises(ValueError, match="no positive amplitude"):
        characteristic.equation_10().amplitude_rps(1e-5)


def test_equation_10_gives_table_2s_backlashes_from_its_amplitudes_in_rps():
    for row, delta_rad in enumerate(characteristic.printed_levels_rad(), start=1):
        amplitude_rps = published.value(f"table2.row{row:02d}.theoretical")
        assert characteristic.equation_10().backlash_rad(amplitude_rps) == pytest.approx(
            delta_rad, abs=2e-5
        )
