import re

import pytest

import workbook
from replication import figures

FIGURES = sorted((workbook.ROOT / "figures").glob("*.svg"))

# Axes without a unit: ratios of like quantities, and counts.
DIMENSIONLESS = {
    "generation",
    "number of robots",
    "row of Table 2 (11: noise alone)",
    "stiffness over the paper's",
}


@pytest.mark.parametrize("figure", FIGURES, ids=lambda path: path.stem)
def test_every_axis_of_a_figure_has_a_unit_or_is_known_to_have_none(figure):
    written = figure.read_text(encoding="utf-8")
    described = re.search(r"<dc:description>(.*?)</dc:description>", written, re.DOTALL)
    labels = [label.strip() for label in re.split("; | versus ", described[1])]
    assert labels
    assert [name for name in labels if name not in DIMENSIONLESS and "[" not in name] == []


def test_a_figure_says_what_its_axes_are(tmp_path):
    figure, axes = figures.grid(1, 2)
    axes[0, 0].set(xlabel="time [s]", ylabel="speed\n[rps]")
    axes[0, 1].set(xlabel="time [s]")
    figure.supxlabel("backlash [rad]")
    figures.save(figure, tmp_path, "small")
    written = (tmp_path / "small.svg").read_text(encoding="utf-8")
    assert "speed [rps] versus time [s]; time [s]; backlash [rad]" in written
