"""The figures that the notebooks exported: what each shows, which notebook made it, and the drawing."""

import base64
import html
import io
import json
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from markupsafe import Markup
from PIL import Image

from replication.report import web

FIGURE_NAME = re.compile(r"(figure|table|equation)0*(\d+)_")
COLOURS = 48  # enough for lines and markers with smooth edges; a third of the size
LARGEST = 30_000  # characters; a larger figure stands in the report at half its size, with a link to the whole


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
        return self._element(data_uri(self.file))

    @property
    def light_image(self) -> Markup:
        """The drawing for a page with many of them: at half its size if it is large."""
        whole = data_uri(self.file)
        return self._element(whole if len(whole) <= LARGEST else data_uri(self.file, 0.5))

    def _element(self, source: str) -> Markup:
        width, height = size(self.file)
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
        if anchor := web.cell_with(notebook, "save_figure(", f'"{picture.name}"'):
            placed.setdefault(anchor, []).append(picture)
    return placed


@cache
def data_uri(file: Path, scale: float = 1.0) -> str:
    """Read a drawing as a data address, with few colours."""
    return light(file.read_bytes(), scale)


def light(content: bytes, scale: float = 1.0) -> str:
    """Turn a PNG into a data address, with few colours."""
    image = Image.open(io.BytesIO(content)).convert("RGB")
    if scale != 1:
        image = image.resize((round(scale * image.width), round(scale * image.height)), Image.Resampling.LANCZOS)
    few = image.quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).convert("RGB")
    buffer = io.BytesIO()
    few.save(buffer, "WEBP", lossless=True, quality=80, method=4)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def size(file: Path) -> tuple[int, int]:
    """Width and height of a drawing as it is to be shown, at 100 dots per inch."""
    with Image.open(file) as image:
        return round(image.width / 1.5), round(image.height / 1.5)
