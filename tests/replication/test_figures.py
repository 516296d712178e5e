import re

import pytest
from matplotlib import pyplot as plt

import workbook
from replication import figures

# Axes without a unit: ratios of like quantities, and counts.
DIMENSIONLESS = {
    "generation",
    "number of robots",
    "row of Table 2 (1*: on a simulated record, 11: noise alone)",
    "measured over limit",
    "numbers and score",
    "periods of the torque in a load turn",
    "start and settings",
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


def test_curves_have_their_names_styles_and_limits():
    figure = figures.curves(
        {"line": ([0, 1], [2, 3]), "mark": (0.5, 2.5, figures.MARKS)},
        "time [s]",
        "$r$ [rps]",
        xlim=(0, 2),
    )
    (axis,) = figure.axes
    line, mark = axis.lines
    assert [line.get_label(), mark.get_label()] == ["line", "mark"]
    assert (line.get_linestyle(), mark.get_linestyle()) == ("-", "None")
    assert axis.get_xlim() == (0, 2)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["line", "mark"]
    plt.close(figure)
