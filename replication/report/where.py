"""Where a number is made: the notebook's cell, by an anchor that stays, and the line of code."""

import ast
import json
import re
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

from replication import published
from replication.workbook.files import ROOT

HEADING = re.compile(r"^(#{1,4}) (.+)$", re.MULTILINE)


@dataclass(frozen=True)
class Made:
    """The notebook and cell that make a number, and the line of code that computes it; empty where it is not known."""

    notebook: str
    anchor: str
    function: str = ""
    file: str = ""
    line: int = 0
    code: str = ""

    @property
    def link(self) -> str:
        """Address of the cell, from the results' folder."""
        return f"pages/{self.notebook}.html#{self.anchor}"


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


def made(cell: str, source: str, notebook: str, notebooks: Path = ROOT / "notebooks") -> Made:
    """Look up where a printed cell's number is made."""
    if not notebook:
        return Made("", "")
    for rule in _rules():
        if fnmatchcase(cell, rule["id"]) and fnmatchcase(source, rule["source"]):
            anchor = cell_with(notebooks / f"{notebook}.ipynb", rule["cell"])
            return Made(notebook, anchor or "verdict", *code_line(rule["function"], rule["line"]))
    return Made(notebook, "verdict")


@cache
def _rules() -> list[dict]:
    return published.where().to_dict("records")


@cache
def code_line(function: str, text: str) -> tuple[str, str, int, str]:
    """Find a line of a function."""
    module, _, name = function.rpartition(".")
    file = Path("replication", *module.split(".")).with_suffix(".py")
    code = (ROOT / file).read_text(encoding="utf-8")
    node = next((n for n in ast.parse(code).body if isinstance(n, ast.FunctionDef) and n.name == name), None)
    if node is None:
        raise KeyError(f"{file} has no function {name}")
    lines = code.splitlines()
    body = range(node.lineno, node.end_lineno + 1)
    line = next((number for number in body if text and text in lines[number - 1]), node.lineno)
    return function, file.as_posix(), line, lines[line - 1].strip()
