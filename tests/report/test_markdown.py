"""The errata sheet, the supplement's list, and the tables that they link to."""

import re

import workbook
from replication import published
from workbook.checkout import RESULTS
from workbook.outcomes import load_outcomes
from workbook.report import facts, markdown


def test_the_errata_sheet_is_what_the_data_give_with_a_row_for_each_erratum(verdicts):
    sheet = markdown.render_errata(facts.collect_facts(RESULTS, verdicts))
    assert (RESULTS / "errata.md").read_text("utf-8") == sheet, "run: make report"
    assert len(re.findall(r"^\| E\d+ ", sheet, re.MULTILINE)) == len(published.table("errata"))


def test_the_errata_sheet_holds_no_tag_that_a_reader_would_run(verdicts, replace_table):
    hostile = published.table("errata").assign(effect="<script>alert(1)</script>")
    replace_table("errata", hostile)
    text = markdown.render_errata(facts.collect_facts(RESULTS, verdicts))
    assert "&lt;script>" in text
    assert "<script" not in text


def test_the_supplement_lists_each_of_its_tables():
    folder, listed = RESULTS / "supplement", markdown.render_supplement(RESULTS)
    assert (folder / "README.md").read_text("utf-8") == listed, "run: make report"
    linked = re.findall(r"^\| \[(\w+)\]\(\1\.csv\) \|", listed, re.MULTILINE)
    assert sorted(linked) == sorted(file.stem for file in folder.glob("*.csv"))


def test_every_table_in_the_results_is_made_by_a_notebook_a_study_or_the_workbook():
    made = {file for outcome in load_outcomes(RESULTS).values() for file in outcome["files"]}
    made |= {"verdicts.csv", "claims.csv"}
    others = {file.name for file in RESULTS.glob("*.csv")} - made
    kinds = ("studies/**/*.py", "replication/**/*.py")
    sources = "".join(path.read_text("utf-8") for k in kinds for path in workbook.ROOT.glob(k))
    assert [name for name in others if f'"{name}"' not in sources] == []
    assert {f"supplement/{file.name}" for file in (RESULTS / "supplement").glob("*.csv")} <= made


def test_the_readmes_block_is_what_the_command_writes():
    text = (workbook.ROOT / "README.md").read_text("utf-8")
    status = f"{markdown.BEGIN}{markdown.render_status(RESULTS)}{markdown.END}"
    assert status in text, "run: make report"
