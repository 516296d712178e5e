"""The figures that the notebooks exported: what each shows, its notebook, and the drawing."""

import html
import re
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup
from PIL import Image

from workbook.outcomes import load_outcomes

FIGURE_NAME = re.compile(r"(figure|table|equation)0*(\d+)_")
IN_ADDRESS = str.maketrans({"%": "%25", "#": "%23", '"': "'"})
DOTS_PER_SHOWN_DOT = 1.5


@dataclass(frozen=True)
class Picture:
    """A figure: its name, its notebook, what to see, its axes in words, and the PNG file."""

    name: str
    notebook: str
    caption: str
    axes: str
    file: Path

    @property
    def element(self) -> str:
        """Element of the paper that its name belongs to; empty for what goes beyond it."""
        found = FIGURE_NAME.match(self.name)
        return f"{found[1].capitalize()} {found[2]}" if found else ""

    @property
    def anchor(self) -> str:
        """Anchor of the figure within its notebook's page."""
        return f"figure-{self.name.replace('_', '-')}"

    @property
    def alternative(self) -> str:
        """What is read aloud in place of the figure: what to see, then the axes."""
        return f"{self.caption} Axes: {self.axes}." if self.axes else self.caption

    def image(self) -> Markup:
        """The drawing as an image of a page."""
        with Image.open(self.file) as image:
            width, height = (round(dots / DOTS_PER_SHOWN_DOT) for dots in image.size)
        label = html.escape(self.alternative)
        drawing = self.file.with_suffix(".svg").read_text(encoding="utf-8")
        source = "data:image/svg+xml," + " ".join(drawing.split()).translate(IN_ADDRESS)
        return Markup(f'<img alt="{label}" width="{width}" height="{height}" src="{source}">')


def load_pictures(results: Path) -> list[Picture]:
    """Load what the notebooks noted of their figures, which lie in the folder beside the results."""
    found = []
    for notebook, outcome in load_outcomes(results).items():
        for name, about in outcome["figures"].items():
            file = results.parent / "figures" / f"{name}.png"
            if file.exists():
                axes = _plain_label(about["axes"])
                found.append(Picture(name, notebook, about["caption"], axes, file))
    return sorted(found, key=lambda picture: (picture.notebook, picture.name))


def _plain_label(label: str) -> str:
    """An axis label without its mathematical markup, for reading aloud."""
    for markup, sign in (("\\delta", "δ"), ("\\Delta", "Δ"), ("\\theta", "θ"), ("\\pm", "±")):
        label = label.replace(markup, sign)
    return re.sub(r"[${}\\]", "", label)
