"""Anchors of a notebook's cells stay."""

from nbformat import v4

from workbook.report import pages

CELLS = [
    *(v4.new_markdown_cell("# Title\n\n## Method"), v4.new_code_cell("a = 1")),
    *(v4.new_markdown_cell("### Table 2"), v4.new_code_cell("b = 2")),
]


def test_a_cells_anchor_stays_when_cells_are_added_under_another_heading():
    before = pages.cell_anchors(CELLS)
    assert before == ["method-cell-1", "method-cell-2", "table-2-cell-1", "table-2-cell-2"]
    after = pages.cell_anchors([*CELLS[:2], v4.new_code_cell("new = 3"), *CELLS[2:]])
    assert after[-2:] == before[-2:]
