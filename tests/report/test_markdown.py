"""The errata sheet, the supplement's list and the README's block."""

import re

import pytest

import workbook
from replication import published
from workbook import judging
from workbook.checkout import RESULTS
from workbook.outcomes import load_outcomes
from workbook.report import facts, markdown


@pytest.fixture(scope="module")
def sheet():
    """The errata sheet, written anew."""
    return markdown.render_errata(facts.collect_facts(RESULTS, judging.verdicts(RESULTS)))


def test_the_errata_sheet_is_what_the_data_give_and_fits_a_page(sheet):
    assert (RESULTS / "errata.md").read_text("utf-8") == sheet, "run: make report"
    rows = [line for line in sheet.splitlines() if re.match(r"\| E\d+ ", line)]
    assert len(rows) == len(published.errata())
    assert all(row.replace("\\|", "").count("|") == 8 for row in rows)
    assert len(sheet.split()) < 900


def test_every_erratum_has_one_of_three_kinds_and_the_sheet_says_how_many_are_of_each(sheet):
    kinds = list(published.errata()["kind"])
    assert set(kinds) == {"paper", "against the public data", "public repository"}
    for kind in set(kinds):
        place = kind if kind.startswith("against") else f"in the {kind}"
        assert f"{kinds.count(kind)} {place}" in sheet


def test_the_supplement_lists_each_of_its_tables_with_a_sentence():
    folder, listed = RESULTS / "supplement", markdown.render_supplement(RESULTS)
    assert (folder / "README.md").read_text("utf-8") == listed, "run: make report"
    linked = re.findall(
        r"^\| \[(\w+)\]\(\1\.csv\) \| [A-Z][^|]+\. \| \[\d+\]", listed, re.MULTILINE
    )
    assert sorted(linked) == sorted(file.stem for file in folder.glob("*.csv"))


def test_every_table_in_the_results_is_made_by_a_notebook_a_study_or_the_workbook():
    made = {file for outcome in load_outcomes(RESULTS).values() for file in outcome["files"]}
    made |= {"verdicts.csv", "claims.csv"}
    others = {file.name for file in RESULTS.glob("*.csv")} - made
    places = [*workbook.ROOT.glob("studies/*.py"), *workbook.ROOT.glob("tests/tools/*.py")]
    sources = "".join(
        path.read_text("utf-8") for path in [*places, *workbook.ROOT.glob("replication/**/*.py")]
    )
    assert [name for name in others if f'"{name}"' not in sources] == []
    assert {f"supplement/{file.name}" for file in (RESULTS / "supplement").glob("*.csv")} <= made


def test_the_readmes_block_is_what_the_command_writes():
    text = (workbook.ROOT / "README.md").read_text("utf-8")
    status = f"{markdown.BEGIN}{markdown.render_status(RESULTS)}{markdown.END}"
    assert status in text, "run: make report"


def test_a_readme_without_the_marks_is_refused(tmp_path):
    (tmp_path / "README.md").write_text("no marks")
    with pytest.raises(ValueError, match="status: begin"):
        markdown.update_readme(tmp_path / "README.md", RESULTS)
