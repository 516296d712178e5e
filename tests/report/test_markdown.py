"""The errata sheet and the README's blocks."""

import re

import pytest
from places import RESULTS

import workbook
from replication import published
from workbook.report import markdown


def test_the_errata_sheet_is_what_the_data_give_and_fits_a_page():
    sheet = markdown.render_errata()
    assert (RESULTS / "errata.md").read_text(encoding="utf-8") == sheet, "run: make report"
    rows = [line for line in sheet.splitlines() if re.match(r"\| E\d+ ", line)]
    assert len(rows) == len(published.errata())
    assert all(row.replace("\\|", "").count("|") == 8 for row in rows)
    assert len(sheet.split()) < 900


def test_every_erratum_has_one_of_three_kinds_and_the_sheet_says_how_many_are_of_each():
    kinds = list(published.errata()["kind"])
    assert set(kinds) == {"paper", "against the public data", "public repository"}
    for kind in set(kinds):
        place = kind if kind.startswith("against") else f"in the {kind}"
        assert f"{kinds.count(kind)} {place}" in markdown.render_errata()


def test_every_proof_of_an_erratum_is_a_test_that_is_there():
    for evidence in published.errata()["evidence"]:
        file, _, test = evidence.partition("::")
        assert f"def {test}(" in (workbook.ROOT / file).read_text(encoding="utf-8")


def test_the_readmes_blocks_are_what_the_command_writes():
    text = (workbook.ROOT / "README.md").read_text(encoding="utf-8")
    status = f"{markdown.BEGIN}{markdown.render_status(RESULTS)}{markdown.END}"
    assert status in text, "run: python -m workbook readme"


def test_a_readme_without_the_marks_is_refused(tmp_path):
    (tmp_path / "README.md").write_text("no marks")
    with pytest.raises(ValueError, match="status: begin"):
        markdown.update_readme(tmp_path / "README.md", RESULTS)
