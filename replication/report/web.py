"""What the pages share: the templates, and anchors that stay where they are when cells are added elsewhere."""

import json
import re
from functools import cache
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

ENVIRONMENT = Environment(
    loader=PackageLoader("replication.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
)
HEADING = re.compile(r"^(#{1,4}) (.+)$", re.MULTILINE)


def slug(text: str) -> str:
    """Turn a heading into an anchor: small letters and digits, joined by hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", re.sub(r"[$\\]", "", text.lower())).strip("-")


def headings(source: str) -> list[str]:
    """Headings of a markdown cell."""
    return [text for _, text in HEADING.findall(source)]


def cell_anchors(cells: list[tuple[str, str]]) -> list[str]:
    """Name each cell of a notebook after the heading above it and its place there.

    Cells added elsewhere leave the name alone.
    """
    section, position, anchors = "top", 0, []
    for kind, source in cells:
        if kind == "markdown" and (found := headings(source)):
            section, position = slug(found[-1]), 0
        position += 1
        anchors.append(f"{section}-cell-{position}")
    return anchors


@cache
def notebook_cells(notebook: Path) -> tuple[tuple[str, str], ...]:
    """Kind and source of each cell of an executed notebook; none if it is not there."""
    if not notebook.exists():
        return ()
    content = json.loads(notebook.read_text(encoding="utf-8"))
    return tuple((cell["cell_type"], "".join(cell["source"])) for cell in content["cells"])


def title(notebook: Path) -> str:
    """A notebook's title: its first heading, formulas as they are written."""
    return next(text for _, source in notebook_cells(notebook) for text in headings(source))


def cell_with(notebook: Path, *texts: str) -> str | None:
    """Anchor of the first code cell whose source holds all of the texts; None if there is none."""
    cells = notebook_cells(notebook)
    named = zip(cells, cell_anchors(list(cells)), strict=True)
    return next(
        (anchor for (kind, source), anchor in named if kind == "code" and all(text in source for text in texts)), None
    )
