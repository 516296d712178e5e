import re

import pytest

import workbook

# Axes without a unit: ratios of like quantities, and counts.
DIMENSIONLESS = {
    "backlash of the bench",  # its ticks have the unit
    "generation",
    "number of robots",
    "row of Table 2 (1*: on a simulated record, 11: noise alone)",
    "measured over limit",
    "numbers and score",
    "periods of the torque in a load turn",
    "settings",
    "stiffness over the paper's",
    "search",
}


@pytest.mark.parametrize("figure", [*(workbook.ROOT / "figures").glob("*.svg")], ids=str)
def test_every_axis_of_a_figure_has_a_unit_or_is_known_to_have_none(figure):
    written = figure.read_text(encoding="utf-8")
    described = re.search(r"<dc:description>(.*?)</dc:description>", written, re.DOTALL)
    labels = {label.strip() for label in re.split("; | versus ", described[1])}
    assert labels
    assert all("[" in name for name in labels - DIMENSIONLESS), labels
