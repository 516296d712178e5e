"""The figures that the notebooks exported: what each shows, which notebook made it, and the drawing."""

import html
import json
import re
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from replication.report import drawings, where

FIGURE_NAME = re.compile(r"(figure|table|equation)0*(\d+)_")


@dataclass(frozen=True)
class Picture:
    """A figure: its name, the notebook that made it, what to see, its axes in words, and the PNG file."""

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

    @property
    def image(self) -> Markup:
        """The drawing as an element of a page."""
        return self._element(drawings.data_uri(self.file))

    @property
    def light_image(self) -> Markup:
        """The drawing for a page with many of them: at half its size if it is large."""
        whole = drawings.data_uri(self.file)
        return self._element(whole if len(whole) <= drawings.LARGEST else drawings.data_uri(self.file, 0.5))

    def _element(self, source: str) -> Markup:
        width, height = drawings.size(self.file)
        label = html.escape(self.alternative)
        return Markup(f'<img alt="{label}" width="{width}" height="{height}" src="{source}">')


def pictures(results: Path, figures: Path) -> list[Picture]:
    """Load what the notebooks noted of the figures that they exported."""
    found = []
    for note in sorted((results / "figures").glob("*.json")):
        about = json.loads(note.read_text(encoding="utf-8"))
        file = figures / f"{note.stem}.png"
        if file.exists():
            axes = plain(about["axes"])
            found.append(Picture(note.stem, about["notebook"], about["caption"], axes, file))
    return sorted(found, key=lambda picture: (picture.notebook, picture.name))


def plain(label: str) -> str:
    """An axis label without its mathematical markup, for reading aloud."""
    for markup, sign in (("\\delta", "δ"), ("\\Delta", "Δ"), ("\\theta", "θ"), ("\\pm", "±")):
        label = label.replace(markup, sign)
    return re.sub(r"[${}\\]", "", label)


def shown_in(notebook: Path, drawn: list[Picture]) -> dict[str, list[Picture]]:
    """Figures of a notebook by the anchor of the cell that exports them."""
    own = [picture for picture in drawn if picture.notebook == notebook.stem]
    placed: dict[str, list[Picture]] = {}
    for picture in own:
        if anchor := where.cell_with(notebook, "save_figure(", f'"{picture.name}"'):
            placed.setdefault(anchor, []).append(picture)
    return placed
