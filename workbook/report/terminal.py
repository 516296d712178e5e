"""Cells, elements and claims on a terminal, in the paper's shape."""

import os
import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from replication import published
from workbook import judging
from workbook.report import TEMPLATES
from workbook.report.cells import SIGNS, Cell, judged_cells, judged_claims, notebook_source
from workbook.report.facts import collect_facts, fill
from workbook.report.tables import LAYOUTS, Entry, table_rows

COLOURS = {"reproduced": 32, "holds": 32, "erratum": 35, "differs": 31, "does not hold": 31}
WIDTH, LABEL_WIDTH = 100, 16


class Unknown(ValueError):
    """There is no such cell, element or claim."""

    exit_status = 2


def has_colour() -> bool:
    """Whether the terminal shows colours and the user has not asked for none."""
    return sys.stdout.isatty() and "NO_COLOR" not in os.environ and os.environ.get("TERM") != "dumb"


def paint(text: str, verdict: str, colour: bool) -> str:
    """Colour a text by its verdict."""
    code = COLOURS.get(verdict)
    return f"\033[{code}m{text}\033[0m" if colour and code else text


def verdict_tables(verdicts: pd.DataFrame, colour: bool) -> str:
    """Write every printed number beside ours, element by element, then the counts."""
    cells = judged_cells(verdicts)
    counts = judging.verdict_counts(verdicts).sum().astype(int).to_dict()
    evidence = sum(counts.get(name, 0) for name in judging.EVIDENCE)
    signs = ", ".join(f"{SIGNS[name]} {name}" for name in counts)
    legend = "Each cell: printed | ours, from the authors' data if there are any, then from our simulation."
    counted = ", ".join(f"{SIGNS[name]} {name} {count}" for name, count in counts.items())
    summary = (
        f"{evidence} of {len(cells)} printed numbers are decided by evidence, "
        f"{counts.get('traced', 0)} are traced to the authors' own files: {counted}"
    )
    elements = dict.fromkeys(cell.element for cell in cells.values())
    parts = [f"{legend}\n{signs}.", *(_element(name, cells, colour) for name in elements), summary]
    return "\n\n".join(parts)


def _element(element: str, cells: Mapping[str, Cell], colour: bool) -> str:
    """An element's cells, each as "printed | ours sign", ours from each source that judges it."""
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
    lines = [title]
    for line in grid:
        padded = []
        for entry, width in zip(line, widths, strict=True):
            verdict = entry.deciding.verdict if isinstance(entry, Cell) else ""
            padded.append(paint(f"{_short(entry):<{width}}", verdict, colour))
        lines.append("  " + "  ".join(padded).rstrip())
    return "\n".join(lines)


def _short(entry: Entry) -> str:
    if not isinstance(entry, Cell):
        return entry
    ours = (f"{entry.ours(each) or ' '} {SIGNS[each.verdict]}" for each in entry.judgements)
    return f"{entry.printed} | {', '.join(ours)}"


def find_surprises(verdicts: pd.DataFrame) -> tuple[list[str], list[str]]:
    """Cells that differ unexpectedly, and known differences that no longer differ."""
    known, differs = published.known_differences(), verdicts[verdicts["verdict"] == "differs"]
    expected, found, run = (
        {f"{row.id} ({row.source})" for row in table.itertuples()}
        for table in (known, differs, verdicts)
    )
    new = [f"{cell} differs and is not a known difference" for cell in sorted(found - expected)]
    gone = sorted((expected - found) & run)
    return new, [f"{cell} is a known difference and no longer differs" for cell in gone]


def show(name: str, results: Path, verdicts: pd.DataFrame, colour: bool) -> str:
    """Describe a cell, an element, a claim or an erratum."""
    wanted, cells = judging.squeeze(name), judged_cells(verdicts)
    facts, errata = collect_facts(results, verdicts), published.errata()
    errata["computed"] = [fill(text, facts) for text in errata["computed"]]
    kinds: dict[str, Mapping] = {
        "cell": cells,
        "claim": {row["id"]: row for row in judged_claims(results)},
        "erratum": errata.to_dict("index"),
    }
    for kind, found in kinds.items():
        for key, item in found.items():
            if key.lower() == wanted:
                return _describe(kind, item, colour)
    for element in (cell.element for cell in cells.values()):
        if judging.squeeze(element) == wanted:
            return _element(element, cells, colour)
    near = [cell for cell in cells if wanted in cell.lower()][:6]
    hint = (
        f"did you mean {', '.join(near)}?" if near else "`python -m workbook check` lists all cells"
    )
    raise Unknown(f"{name}: no such cell, element, claim or erratum; {hint}")


def _describe(kind: str, item: object, colour: bool) -> str:
    """What the template says of it, labels in one column and texts in another."""
    text = TEMPLATES.get_template("show.txt.j2").render(
        {kind: item},
        verdict=lambda name: paint(f"{SIGNS[name]} {name}", name, colour),
        notebook=lambda name: f"{notebook_source(name)}; results/pages/{name}.html#verdict",
    )
    lines = []
    for line in text.splitlines():
        label, _, said = line.partition(": ")
        indented = f"{label:<{LABEL_WIDTH}}{said}"
        lines.append(textwrap.fill(indented, WIDTH, subsequent_indent=" " * LABEL_WIDTH))
    return "\n".join(lines)
