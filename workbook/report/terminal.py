"""Printed numbers, claims and errata on a terminal."""

import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path

import pandas as pd

from replication import published
from workbook import judging
from workbook.report import TEMPLATES, Unknown, squeeze
from workbook.report.cells import Cell, judged_cells, judged_claims, notebook_source
from workbook.report.facts import collect_facts, list_errata

WIDTH, LABEL_WIDTH = 100, 16
LABELS = ("", "printed", "ours", "difference", "interval", "", "source")


def verdict_tables(verdicts: pd.DataFrame) -> str:
    """Write the printed numbers beside ours, element by element, then the counts by element and by source.

    Of what the text says, numbers that are only taken over are counted.
    """
    cells = judged_cells(verdicts).values()
    shown = [cell for cell in cells if cell.element != "Text" or cell.source != "taken over"]
    parts = [
        _element(name, (cell for cell in shown if cell.element == name))
        for name in dict.fromkeys(cell.element for cell in shown)
    ]
    parts += [judging.count_by(verdicts, by).to_string() for by in ("element", "source")]
    parts.append(
        f"{len(cells) - len(shown)} numbers of the text that are taken over are not listed "
        "(`make show CELL=text`). ○ agrees weakly: a large deviation would have agreed too."
    )
    return "\n\n".join(parts)


def _element(element: str, cells: Iterable[Cell]) -> str:
    """The cells of an element as a table, a line each."""
    grid = [LABELS, *(_line(cell) for cell in cells)]
    widths = [max(map(len, column)) for column in zip(*grid, strict=True)]
    lines = (
        "  ".join(entry.ljust(width) for entry, width in zip(line, widths, strict=True)).rstrip()
        for line in grid
    )
    return "\n  ".join([element, *lines])


def _line(cell: Cell) -> tuple[str, ...]:
    """A cell's entries under `LABELS`."""
    name = cell.id.partition(".")[2]
    difference = cell.percent or cell.difference
    agreement = f"{cell.sign} {cell.words}"
    return (name, cell.printed, cell.ours, difference, cell.interval, agreement, cell.source)


def find_surprises(verdicts: pd.DataFrame) -> tuple[list[str], list[str]]:
    """Cells that differ unexpectedly, and known differences that no longer differ."""
    cells = published.cells()
    known = {*cells.index[cells["known_difference"] != ""]}
    differs = {*verdicts.loc[verdicts["agreement"] == "differs", "id"]}
    gone = {*verdicts.loc[verdicts["agreement"] == "agrees", "id"]} & known
    new = [f"{cell} differs and is not a known difference" for cell in sorted(differs - known)]
    return new, [f"{cell} is a known difference and no longer differs" for cell in sorted(gone)]


def show(name: str, results: Path) -> str:
    """Describe a cell, an element, a claim or an erratum by its name, as `squeeze` gives it."""
    verdicts = judging.verdicts(results)
    cells = judged_cells(verdicts)
    kinds: dict[str, Mapping] = {
        "cell": cells,
        "claim": {row["id"]: row for row in judged_claims(results)},
        "erratum": list_errata(collect_facts(results, verdicts)).set_index("id").to_dict("index"),
    }
    for kind, found in kinds.items():
        for key, item in found.items():
            if key.lower() == name:
                shown = {kind: item, "notebook": _place_of_notebook}
                return align(TEMPLATES.get_template("show.txt.j2").render(shown))
    for element in dict.fromkeys(cell.element for cell in cells.values()):
        if squeeze(element) == name:
            return _element(element, (cell for cell in cells.values() if cell.element == element))
    near = [cell for cell in cells if name in cell.lower()][:6]
    hint = f"did you mean {', '.join(near)}?" if near else "`make check` lists all cells"
    raise Unknown(f"{name}: no such cell, element, claim or erratum; {hint}")


def _place_of_notebook(name: str) -> str:
    return f"{notebook_source(name)}; results/pages/{name}.html#verdict"


def align(text: str) -> str:
    """Put the labels of "label: text" lines into one column and the texts into another."""
    lines = []
    for line in text.splitlines():
        label, _, said = line.partition(": ")
        indented = f"{label:<{LABEL_WIDTH}}{said}" if len(label) < LABEL_WIDTH else line
        lines.append(textwrap.fill(indented, WIDTH, subsequent_indent=" " * LABEL_WIDTH))
    return "\n".join(lines)
