"""Cells, elements and claims on a terminal, in the paper's shape."""

import textwrap
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from replication import published
from workbook import judging
from workbook.report import TEMPLATES, Unknown, squeeze
from workbook.report.cells import SIGNS, Cell, judged_cells, judged_claims, notebook_source
from workbook.report.facts import collect_facts, fill
from workbook.report.tables import LAYOUTS, Entry, table_rows

WIDTH, LABEL_WIDTH = 100, 16


def verdict_tables(verdicts: pd.DataFrame) -> str:
    """Write the printed numbers beside ours, element by element, then the counts by source.

    Of what the text says, numbers that are only taken over are counted.
    """
    cells = judged_cells(verdicts)
    compared = {
        name: cell
        for name, cell in cells.items()
        if cell.element != "Text" or cell.source != "taken over"
    }
    return TEMPLATES.get_template("check.txt.j2").render(
        elements=[_element(name, compared) for name in published.cells()["element"].unique()],
        taken_over=len(cells) - len(compared),
        cells=cells,
        sources=judging.count_by(verdicts, "source").to_string(),
    )


def _element(element: str, cells: Mapping[str, Cell]) -> str:
    """An element's cells, each as "printed | ours sign"; Table 2's means and SDs with their intervals beneath."""
    layout = next((layout for layout in LAYOUTS if layout["element"] == element), None)
    grid: list[list[Entry]]
    if layout:
        title = f"{element}  {layout['caption']}"
        grid = [[layout["row_heading"], *(column["heading"] for column in layout["columns"])]]
        grid += [[heading, *entries] for heading, entries in table_rows(layout, cells)]
    else:
        title = element
        own = [cell for cell in cells.values() if cell.element == element]
        grid = []
        for cell in own:
            name = cell.row if cell.column == "value" else cell.column
            grid.append([name, cell, "" if cell.unit == "1" else cell.unit, cell.id])
    widths = [max(len(_short(entry)) for entry in column) for column in zip(*grid, strict=True)]
    template = TEMPLATES.get_template("element.txt.j2")
    return template.render(title=title, grid=grid, widths=widths, short=_short)


def _short(entry: Entry) -> str:
    if not isinstance(entry, Cell):
        return entry
    return f"{entry.printed} | {entry.ours or ' '} {entry.sign}"


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
    verdicts, errata = judging.verdicts(results), published.table("errata")
    cells = judged_cells(verdicts)
    facts = collect_facts(results, verdicts)
    errata["computed"] = [fill(text, facts) for text in errata["computed"]]
    kinds: dict[str, Mapping] = {
        "cell": cells,
        "claim": {row["id"]: row for row in judged_claims(results)},
        "erratum": errata.to_dict("index"),
    }
    for kind, found in kinds.items():
        named = {key.lower(): item for key, item in found.items()}
        if name in named:
            return _describe(kind, named[name])
    for element in (cell.element for cell in cells.values()):
        if squeeze(element) == name:
            return _element(element, cells)
    near = [cell for cell in cells if name in cell.lower()][:6]
    hint = f"did you mean {', '.join(near)}?" if near else "`make check` lists all cells"
    raise Unknown(f"{name}: no such cell, element, claim or erratum; {hint}")


def _describe(kind: str, item: object) -> str:
    """What the template says of it."""
    text = TEMPLATES.get_template("show.txt.j2").render(
        {kind: item},
        verdict=lambda name: f"{SIGNS[name]} {name}",
        notebook=lambda name: f"{notebook_source(name)}; results/pages/{name}.html#verdict",
    )
    return align(text)


def align(text: str) -> str:
    """Put the labels of "label: text" lines into one column and the texts into another."""
    lines = []
    for line in text.splitlines():
        label, _, said = line.partition(": ")
        indented = f"{label:<{LABEL_WIDTH}}{said}"
        lines.append(textwrap.fill(indented, WIDTH, subsequent_indent=" " * LABEL_WIDTH))
    return "\n".join(lines)
