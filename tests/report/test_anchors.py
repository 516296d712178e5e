"""Anchors of a notebook's cells stay."""

from replication.report import web

CELLS = [("markdown", "# Title\n\n## Method"), ("code", "a = 1"), ("markdown", "### Table 2"), ("code", "b = 2")]


def test_a_cells_anchor_stays_when_cells_are_added_under_another_heading():
    before = web.cell_anchors(CELLS)
    assert before == ["method-cell-1", "method-cell-2", "table-2-cell-1", "table-2-cell-2"]
    after = web.cell_anchors([*CELLS[:2], ("code", "new = 3"), *CELLS[2:]])
    assert after[-2:] == before[-2:]
