"""Figures light enough to stand inside a page."""

import base64
import io
from functools import cache
from pathlib import Path

from PIL import Image

COLOURS = 20  # enough for lines and markers with smooth edges; a quarter of the size


@cache
def png_uri(file: Path) -> str:
    """Read a PNG as a data address, with few colours."""
    return light_png(file.read_bytes())


def light_png(content: bytes) -> str:
    """Turn a PNG into a data address, with few colours."""
    image = Image.open(io.BytesIO(content)).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    image.save(buffer, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def size(file: Path) -> tuple[int, int]:
    """Width and height of a PNG as it is to be shown, at 100 dots per inch."""
    with Image.open(file) as image:
        return round(image.width / 1.5), round(image.height / 1.5)
