"""Figures light enough to stand inside a page."""

import base64
import io
from functools import cache
from pathlib import Path

from PIL import Image

COLOURS = 48  # enough for lines and markers with smooth edges; a third of the size
LARGEST = 30_000  # characters; a larger figure stands in the report at half its size, with a link to the whole


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
