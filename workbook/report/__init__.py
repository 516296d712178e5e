"""What a reader sees: the report, the notebooks' pages, the article, and the same on a terminal."""

import re
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from replication.files import ROOT

TEMPLATES = Environment(
    # What a study draws in a page of its own lies with the study.
    loader=FileSystemLoader([Path(__file__).parent / "templates", ROOT / "studies" / "pages"]),
    autoescape=lambda name: name is not None and name.endswith(".html.j2"),
    undefined=StrictUndefined,
    trim_blocks=True,
)


class Unknown(ValueError):
    """There is no such cell, element or claim, or no notebook makes it."""

    exit_status = 2


def squeeze(name: str) -> str:
    """A cell's or an element's name as the results have it: "table2.row08.sd" for "Table 2.row8.SD"."""
    return re.sub(r"\brow(\d)\b", r"row0\1", name.lower().replace(" ", ""))
