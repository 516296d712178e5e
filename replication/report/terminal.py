"""Cells, elements and claims on a terminal: in the paper's shape, with colour where there is one."""

import os
import sys
import textwrap
from pathlib import Path

import pandas as pd

from replication import published
from replication.report import cells as cells_of
from replication.report import page, regions, tables
from replication.report.cells import SIGNS, Cell

COLOURS = {"reproduced": 32, "holds": 32, "erratum": 35, "differs": 31, "does not hold": 31}
WIDTH = 100


class Unknown(ValueError):
    """There is no such cell, element or claim."""


def colourful() -> bool:
    """Whether the terminal shows colours and the user has not asked for none."""
    return sys.stdout.isatty() and "NO_COLOR" not in os.environ and os.environ.get("TERM") != "dumb"


def paint(text: str, verdict: str, colour: bool) -> str:
    """Colour a text by its verdict."""
    code = COLOURS.get(verdict)
    return f"\033[{code}m{text}\033[0m" if colour and code else text


# ---------------------------------------------------------------------------------------------------------------
# All verdicts


def verdict_tables(verdicts: pd.DataFrame, colour: bool) -> str:
    """Write every printed cell beside ours, table by table in the paper's shape, then the counts."""
    all_cells = cells_of.cells(verdicts)
    parts = [_table(layout, tables.rows(layout, all_cells), colour) for layout in tables.LAYOUTS]
    for element in ("Equation 10", "Text"):
        lines = [_line([_first(cell)], [cell.id, *_entry(cell)], colour) for cell in tables.others(all_cells, element)]
        parts.append("\n".join([element, *lines]))
    signs = ", ".join(f"{SIGNS[name]} {name} {number}" for name, number in cells_of.counts(all_cells).items())
    evidence = sum(cell.deciding.verdict in cells_of.EVIDENCE for cell in all_cells)
    parts.append(f"{evidence} of {len(all_cells)} printed numbers decided by evidence: {signs}")
    return "\n\n".join(parts)


def _first(cell: Cell) -> str:
    return cell.deciding.verdict


def _entry(cell: Cell) -> list[str]:
    """A cell in short: printed, then ours with the sign of each verdict."""
    ours = [f"{page.ours(cell, each) or ' '} {SIGNS[each.verdict]}" for each in cell.judgements]
    return [cell.printed, *ours]


def _line(verdicts: list[str], texts: list[str], colour: bool) -> str:
    name, *rest = texts
    return f"  {name:<28}" + paint(" | ".join(f"{text:>12}" for text in rest), verdicts[0], colour)


def _table(layout: tables.Layout, rows: list[tables.Row], colour: bool) -> str:
    """A table: each cell as "printed | ours sign", ours from the authors' data, then from our simulation."""
    grid = [[layout.row_heading, *(column.heading for column in layout.columns)]]
    verdicts = [[""] * len(grid[0])]
    for row in rows:
        texts, found = [row.heading], [""]
        for item in row.entries:
            is_cell = isinstance(item, Cell)
            texts.append(" | ".join([_entry(item)[0], ", ".join(_entry(item)[1:])]) if is_cell else item or "")
            found.append(_first(item) if is_cell else "")
        grid.append(texts)
        verdicts.append(found)
    widths = [max(len(line[k]) for line in grid) for k in range(len(grid[0]))]
    lines = [f"{layout.element}  {layout.caption}"]
    for texts, found in zip(grid, verdicts, strict=True):
        padded = (paint(f"{t:<{w}}", v, colour) for t, w, v in zip(texts, widths, found, strict=True))
        lines.append("  " + "  ".join(padded).rstrip())
    return "\n".join(lines)


def unexpected(verdicts: pd.DataFrame) -> list[str]:
    """Cells that differ and are not among the known differences, and known ones that no longer differ."""
    differs = verdicts[verdicts["verdict"] == "differs"]
    found = set(zip(differs["id"], differs["source"], strict=True))
    known = published.known_differences()
    expected = set(zip(known["id"], known["source"], strict=True))
    run = set(zip(verdicts["id"], verdicts["source"], strict=True))
    return [
        *(
            f"{cell} ({source}) differs, and is not among the known differences"
            for cell, source in sorted(found - expected)
        ),
        *(
            f"{cell} ({source}) is a known difference and no longer differs"
            for cell, source in sorted((expected - found) & run)
        ),
    ]


# ---------------------------------------------------------------------------------------------------------------
# One of them


def show(name: str, results: Path, verdicts: pd.DataFrame, colour: bool) -> str:
    """Tell what there is to say of a cell, an element or a claim."""
    all_cells = cells_of.cells(verdicts)
    wanted = name.lower()
    if cell := next((cell for cell in all_cells if cell.id.lower() == wanted), None):
        return _cell(cell, colour)
    if claim := next((row for row in page.claim_rows(results) if row["id"].lower() == wanted), None):
        return _claim(claim, colour)
    errata = published.errata()
    if erratum := next((key for key in errata.index if key.lower() == wanted), None):
        return _wrap([(column.replace("_", " "), str(errata.loc[erratum, column])) for column in errata.columns])
    elements = {cell.element.lower().replace(" ", ""): cell.element for cell in all_cells}
    if element := elements.get(wanted.replace(" ", "")):
        layout = next((layout for layout in tables.LAYOUTS if layout.element == element), None)
        if layout:
            return _table(layout, tables.rows(layout, all_cells), colour)
        own = tables.others(all_cells, element)
        return "\n".join(_line([_first(cell)], [cell.id, *_entry(cell)], colour) for cell in own)
    near = [cell.id for cell in all_cells if wanted in cell.id.lower()][:6]
    hint = f"; is it {', '.join(near)}?" if near else "; `python -m replication check` lists all"
    raise Unknown(f"{name}: no such cell, element, claim or erratum{hint}")


def _cell(cell: Cell, colour: bool) -> str:
    unit = f" {cell.unit}" if cell.unit not in ("1", "%") else ""
    lines = [("", f"{page.cell_name(cell)} ({cell.section})"), ("printed", f"{cell.printed}{unit}")]
    for each in cell.judgements:
        off = f" ({page.difference(each)})" if page.difference(each) else ""
        lines += [("", ""), ("from", cells_of.SOURCES.get(each.source, each.source))]
        lines.append(("ours", f"{cells_of.number(each.ours) or '-'}{off}"))
        lines.append(("verdict", paint(f"{SIGNS[each.verdict]} {each.verdict}", each.verdict, colour)))
        if each.predicted:
            lines.append(("by tolerance", each.by_tolerance))
        lines.append(("region", regions.region(each)))
        if each.reason != cell.tolerance_reason:
            lines.append(("why", each.reason))
        if each.fails_if:
            lines.append(("fails if", each.fails_if))
        if each.notebook:
            lines.append(("made in", f"notebooks/{each.notebook}.py; results/pages/{each.notebook}.html#verdict"))
    lines += [("", ""), ("tolerance", f"{cell.tolerance:.3g}: {cell.tolerance_reason}")]
    if any(each.notebook for each in cell.judgements):
        lines.append(("again", f"python -m replication show {cell.id} --rerun"))
    return _wrap(lines)


def _claim(claim: dict, colour: bool) -> str:
    verdict = paint(f"{SIGNS[claim['verdict']]} {claim['verdict']}", claim["verdict"], colour)
    return _wrap(
        [
            ("claim", f"{claim['claim']} ({claim['section']})"),
            ("verdict", verdict),
            ("measured", claim["measured"]),
            ("criterion", claim["check"]),
            ("made in", f"notebooks/{claim['notebook']}.py; results/pages/{claim['notebook']}.html#verdict"),
        ]
    )


def _wrap(lines: list[tuple[str, str]]) -> str:
    """Labels in one column, texts in another."""
    return "\n".join(
        textwrap.fill(text, WIDTH, initial_indent=f"{label:<16}", subsequent_indent=" " * 16) if text else ""
        for label, text in lines
    )
