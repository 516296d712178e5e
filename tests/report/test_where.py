"""Where a number is made: cells' anchors stay, and every rule of `data/where.csv` still finds its place."""

import pytest
from places import NOTEBOOKS, RESULTS

from replication import published
from replication.report import where
from replication.workbook import judging

VERDICTS = judging.verdicts(RESULTS)
CELLS = [("markdown", "# Title\n\n## Method"), ("code", "a = 1"), ("markdown", "### Table 2"), ("code", "b = 2")]


def test_a_cells_anchor_stays_when_cells_are_added_under_another_heading():
    before = where.cell_anchors(CELLS)
    assert before == ["method-cell-1", "method-cell-2", "table-2-cell-1", "table-2-cell-2"]
    after = where.cell_anchors([*CELLS[:2], ("code", "new = 3"), *CELLS[2:]])
    assert after[-2:] == before[-2:]


@pytest.mark.parametrize(
    "rule", published.where().to_dict("records"), ids=lambda rule: f"{rule['id']} {rule['source']}"
)
def test_every_rule_finds_its_line_of_code(rule):
    *_, code = where.code_line(rule["function"], rule["line"])
    assert rule["line"] in code
    assert rule["line"] or code.startswith("def ")


def test_every_number_of_a_table_is_traced_to_a_cell_of_its_notebook_and_a_line():
    of_tables = VERDICTS[VERDICTS["id"].str.startswith(("table", "equation")) & VERDICTS["notebook"].notna()]
    for row in of_tables.to_dict("records"):
        found = where.made(row["id"], row["source"], row["notebook"])
        assert found.file, row["id"]
        assert found.anchor != "verdict", f"{row['id']} ({row['source']}): data/where.csv names no cell of the notebook"


def test_a_number_without_a_rule_leads_to_the_notebooks_verdict():
    assert where.made("text.turns", "authors", "01_signature_figure6", NOTEBOOKS).anchor == "verdict"


def test_a_function_that_is_gone_is_named():
    with pytest.raises(KeyError, match="no function gone"):
        where.code_line("table2.gone", "")
