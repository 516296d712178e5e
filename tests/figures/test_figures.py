import re
from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_rgb

import workbook
from replication.figures import style
from workbook.checkout import notebook_files

FIGURES = sorted((workbook.ROOT / "figures").glob("*.svg"))

# Axes without a unit: ratios of like quantities, and counts.
DIMENSIONLESS = {
    *(
        "A over theoretical A",
        "SD over printed SD",
        "function evaluations per success",
        "generation",
        "population",
        "stored run",
    ),
    *("log-likelihood of the printed Table 2", "mean over the printed one", "row of Table 2"),
    "signed root of the gain in chi squared",
    *(
        "density",
        "rank of the truth in the posterior",
        "share of intervals that hold",
        "nominal level",
    ),
}


PLOTS = (
    "replication/figures/*.py",
    "replication/standins/plots.py",
    "backlash/plots.py",
    "studies/plots.py",
)


def lightness(colour):
    """CIE L* of a colour: how light it is in grey."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    return 116 * np.cbrt(luminance) - 16


@pytest.mark.parametrize("figure", FIGURES, ids=lambda path: path.stem)
def test_every_axis_of_a_figure_has_a_unit_or_is_known_to_have_none(figure):
    described = re.search(
        r"<dc:description>(.*?)</dc:description>", figure.read_text(encoding="utf-8"), re.DOTALL
    )
    labels = [
        label.strip() for panel in described[1].split(";") for label in panel.split(" versus ")
    ]
    assert labels
    for label in labels:
        assert label in DIMENSIONLESS or re.search(r"\[[^\]]+\]", label), label
        assert not re.search(r"\de[-+]?\d", label), f"{label}: a power of ten is typeset"


@pytest.mark.parametrize("figure", FIGURES, ids=lambda path: path.stem)
def test_a_figure_is_narrow_enough_to_be_read_in_a_column_of_85_mm(figure):
    width_pt = float(
        re.search(r'<svg [^>]*width="([\d.]+)pt"', figure.read_text(encoding="utf-8"))[1]
    )
    assert width_pt <= 72 * style.WIDTH_IN + 0.01


def test_no_plot_has_text_below_8_pt():
    for path in (path for pattern in PLOTS for path in workbook.ROOT.glob(pattern)):
        sizes = re.findall(
            r'(?:fontsize=|[ (]size=|"font.size": |labelsize": )([\d.]+)',
            path.read_text(encoding="utf-8"),
        )
        assert all(float(size) >= 8 for size in sizes), path


@pytest.mark.parametrize("figure", FIGURES, ids=lambda path: path.stem)
def test_a_figure_of_the_paper_has_its_number_in_its_name(figure):
    sources = {
        name: path.read_text(encoding="utf-8") for name, path in notebook_files("py").items()
    }
    made_by = next(name for name, text in sources.items() if f'"{figure.stem}"' in text)
    in_paper = re.search(r"_(figure|table)\d+$", made_by)
    numbered = re.match(r"(figure\d\d|table\d+|equation\d+|search|replay)_[a-z]", figure.stem)
    assert numbered or not in_paper, f"{made_by} is of the paper"


def test_the_first_colours_and_the_ink_differ_in_grey():
    colours = (style.INK, style.BLUE, style.GREEN, style.ORANGE)
    for one, other in combinations(map(lightness, colours), 2):
        assert abs(one - other) > 10


def test_a_figure_says_what_its_axes_are(tmp_path):
    figure, axes = style.grid(1, 2)
    axes[0, 0].set(xlabel="time [s]", ylabel="speed\n[rps]")
    axes[0, 1].set(xlabel="time [s]")
    figure.supxlabel("backlash [rad]")
    style.save(figure, tmp_path, "small")
    written = (tmp_path / "small.svg").read_text(encoding="utf-8")
    assert "speed [rps] versus time [s]; time [s]; backlash [rad]" in written


def test_a_finished_figure_has_letters_and_each_label_once():
    figure, axes = style.grid(1, 2)
    for axis in axes.flat:
        axis.plot([0, 1], label="speed")
    style.finish(figure, 1)
    assert [axis.get_title(loc="left") for axis in axes.flat] == ["(a)", "(b)"]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["speed"]
    alone, ((axis,),) = style.grid()
    style.finish(alone, 1)
    assert not axis.get_title(loc="left")
    assert not alone.legends
