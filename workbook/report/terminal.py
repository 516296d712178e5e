"""Cells, elements and claims on a terminal: in the paper's shape, with colour where there is one."""

import os
import sys
import textwrap
from pathlib import Path

import pandas as pd

from replication import published
from workbook import judging
from workbook.report import TEMPLATES
from workbook.report.cells import SIGNS, Cell, judged_cells, judged_claims, notebook_source
from workbook.report.facts import collect_facts, fill
from workbook.report.tables import LAYOUTS, Entry

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
    """Write every printed number beside ours, element by element in the paper's shape, then the counts."""
    cells = judged_cells(verdicts)
    elements = dict.fromkeys(cell.element for cell in cells.values())
    counts = judging.verdict_counts(verdicts).sum().astype(int).to_dict()
    evidence = sum(counts.get(name, 0) for name in judging.EVIDENCE)
    signs = ", ".join(f"{SIGNS[name]} {name} {count}" for name, count in counts.items())
    summary = f"{evidence} of {len(cells)} printed numbers are decided by evidence: {signs}"
    legend = "Each cell: printed | ours, first from the authors' data if there are any, then from our simulation.\n"
    legend += f"{', '.join(f'{SIGNS[name]} {name}' for name in counts)}."
    return "\n\n".join([legend, *(_element(name, cells, colour) for name in elements), summary])


def _element(element: str, cells: dict[str, Cell], colour: bool) -> str:
    """An element's cells, each as "printed | ours sign": ours from the authors' data, then from our simulation."""
    layout = next((layout for layout in LAYOUTS if layout.element == element), None)
    grid: list[list[Entry]]
    if layout:
        title = f"{element}  {layout.caption}"
        grid = [[layout.row_heading, *(column.heading for column in layout.columns)]]
        grid += [[heading, *entries] for heading, entries in layout.rows(cells)]
    else:
        title = element
        own = [cell for cell in cells.values() if cell.element == element]
        names = [cell.row if cell.column == "value" else cell.column for cell in own]
        units = ["" if cell.unit == "1" else cell.unit for cell in own]
        grid = [[name, cell, unit, cell.id] for name, cell, unit in zip(names, own, units, strict=True)]
    widths = [max(len(_short(line[place])) for line in grid) for place in range(len(grid[0]))]
    lines = [title]
    for line in grid:
        padded = [paint(f"{_short(e):<{w}}", _verdict(e), colour) for e, w in zip(line, widths, strict=True)]
        lines.append("  " + "  ".join(padded).rstrip())
    return "\n".join(lines)


def _short(entry: Entry) -> str:
    if not isinstance(entry, Cell):
        return entry
    ours = (f"{entry.ours(each) or ' '} {SIGNS[each.verdict]}" for each in entry.judgements)
    return f"{entry.printed} | {', '.join(ours)}"


def _verdict(entry: Entry) -> str:
    return entry.deciding.verdict if isinstance(entry, Cell) else ""


def find_surprises(verdicts: pd.DataFrame) -> tuple[list[str], list[str]]:
    """Cells that differ and are not among the known differences, and known ones that no longer differ."""
    known, differs = published.known_differences(), verdicts[verdicts["verdict"] == "differs"]
    expected, found, run = (set(zip(table["id"], table["source"], strict=True)) for table in (known, differs, verdicts))
    new = "{} ({}) differs and is not a known difference"
    gone = "{} ({}) is a known difference and no longer differs"
    return (
        [new.format(*each) for each in sorted(found - expected)],
        [gone.format(*each) for each in sorted((expected - found) & run)],
    )


def show(name: str, results: Path, verdicts: pd.DataFrame, colour: bool) -> str:
    """Describe a cell, an element, a claim or an erratum."""
    wanted = name.lower().replace(" ", "")
    cells = judged_cells(verdicts)
    kinds: dict[str, dict] = {
        "cell": cells,
        "claim": {row["id"]: row for row in judged_claims(results)},
        "erratum": published.errata().to_dict("index"),
    }
    for kind, found in kinds.items():
        for key, item in found.items():
            if key.lower() == wanted:
                if kind == "erratum":
                    item["computed"] = fill(item["computed"], collect_facts(results, verdicts))
                return _describe(kind, item, colour)
    for element in (cell.element for cell in cells.values()):
        if element.lower().replace(" ", "") == wanted:
            return _element(element, cells, colour)
    near = [cell for cell in cells if wanted in cell.lower()][:6]
    hint = f"; did you mean {', '.join(near)}?" if near else "; `python -m workbook check` lists all cells"
    raise Unknown(f"{name}: no such cell, element, claim or erratum{hint}")


def _describe(kind: str, item: object, colour: bool) -> str:
    """What the template says of it, labels in one column and texts in another."""
    text = TEMPLATES.get_template("show.txt.j2").render(
        {kind: item},
        verdict=lambda name: paint(f"{SIGNS[name]} {name}", name, colour),
        notebook=lambda name: f"{notebook_source(name)}; results/pages/{name}.html#verdict",
    )
    lines = (line.partition(": ") for line in text.splitlines())
    indent = " " * LABEL_WIDTH
    return "\n".join(
        textwrap.fill(f"{label:<{LABEL_WIDTH}}{said}", WIDTH, subsequent_indent=indent) for label, _, said in lines
    )
