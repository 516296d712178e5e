"""The paper's tables in the paper's shape, by the layouts of `tables.json`."""

from collections.abc import Mapping
from itertools import groupby
from typing import Any

from replication import published
from workbook.report import TEMPLATES
from workbook.report.cells import Cell

Layout = dict[str, Any]
Entry = Cell | str
LAYOUTS: list[Layout] = published.table_layouts()


def table_rows(layout: Layout, cells: Mapping[str, Cell]) -> list[tuple[str, list[Entry]]]:
    """The rows of a table: each a heading and, column by column, a cell or a text."""
    own = [cell for cell in cells.values() if cell.element == layout["element"]]
    placed = {(cell.row, cell.column): cell for cell in own}
    rows = []
    for place, row in enumerate(dict.fromkeys(row for row, _ in placed)):
        entries = [
            column["texts"][place] if "texts" in column else placed.get((row, column["cells"]), "–")
            for column in layout["columns"]
        ]
        rows.append((layout.get("row_names", {}).get(row, row), entries))
    return rows


def headings_over(layout: Layout) -> list[tuple[str, int]]:
    """The upper line of a table's head: each heading, or none, and over how many columns."""
    over = groupby(column.get("over", "") for column in layout["columns"])
    return [(heading, len(list(part))) for heading, part in over]


TEMPLATES.globals.update(table_rows=table_rows, headings_over=headings_over)
