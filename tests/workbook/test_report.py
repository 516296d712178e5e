"""The report and the README say what the results say, in words that follow from them."""

import math
import re
import shutil

import pytest

from replication import published
from replication.files import UserError
from workbook import ROOT, judging, report
from workbook.project import RESULTS

TEXT = (RESULTS / "report.md").read_text("utf-8")
README = (ROOT / "README.md").read_text("utf-8")


@pytest.fixture(scope="module")
def judged():
    return {"verdicts": judging.verdicts(RESULTS), "claims": judging.claims(RESULTS)}


@pytest.fixture(scope="module")
def facts(judged):
    return report.describe(**judged, results=RESULTS)


def render(facts, **changed):
    """The report with other values, or other facts of notebooks."""
    of_notebooks = {name: changed.pop(name) for name in [*changed] if name in facts["f"]}
    return report.render(facts | {"f": facts["f"] | of_notebooks} | changed)[0]


def test_the_committed_report_and_readme_are_those_of_the_results(facts):
    page, status = report.render(facts)
    assert page == TEXT
    assert f"-->\n{status}\n<!--" in README


@pytest.mark.parametrize(
    "absent", [{"f": {}}, {"engine": {}}, {"weak": None}, {"weak": math.nan}], ids=str
)
def test_the_report_refuses_to_say_what_is_absent(facts, absent):
    with pytest.raises(UserError, match=r"run make all$"):
        render(facts, **absent)


def test_a_report_that_lacks_something_writes_nothing(tmp_path, monkeypatch):
    written = {}
    monkeypatch.setattr(report, "write_files", written.update)
    report.write_report(RESULTS, ROOT / "README.md")
    assert {file.name for file in written} >= {"report.md", "verdicts.csv", "README.md"}
    written.clear()
    results = tmp_path / "results"
    results.mkdir()
    shutil.copy(RESULTS / "kept_sha256.json", results)
    with pytest.raises(UserError, match="no notebook has computed it"):
        report.write_report(results, ROOT / "README.md")
    assert not written


STATUS = "<!-- status: begin -->\n-\n<!-- status: end -->\n"
TEXTS = {
    "no mark": b"Words.\n",
    "two pairs of marks": f"{STATUS}Words between.\n{STATUS}".encode(),
    "marks in the other order": b"<!-- status: end -->\n<!-- status: begin -->\n",
    "a merge's mark": f"{STATUS}<<<<<<< HEAD\n".encode(),
    "cut": STATUS.rstrip().encode(),
    "not in UTF-8": f"{STATUS}é\n".encode("latin-1"),
    "empty": b"",
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_a_damaged_readme_or_template_is_one_line_and_nothing_is_written(
    text, tmp_path, monkeypatch, facts
):
    file = tmp_path / "README.md"
    file.write_bytes(text)
    monkeypatch.setattr(report, "describe", lambda *results: facts)
    for judged in ("verdicts", "claims"):
        monkeypatch.setattr(judging, judged, lambda results: None)
    for readme, template in ((file, report.TEMPLATE), (ROOT / "README.md", file)):
        monkeypatch.setattr(report, "TEMPLATE", template)
        if template == file:
            file.write_bytes(text.replace(b"Words", b"{% if"))
        with pytest.raises(UserError, match=rf"^{file}: .*git checkout brings it back$"):
            report.write_report(RESULTS, readme)
    assert [*tmp_path.iterdir()] == [file]


def test_every_link_of_report_and_readme_leads_to_a_file():
    for folder, text in ((RESULTS, TEXT), (ROOT, README)):
        for target in re.findall(r"\]\(([^)#]+)", text):
            assert target.startswith("http") or (folder / target).exists(), target


def test_make_check_prints_every_number_and_notices_a_new_difference(judged):
    verdicts = judged["verdicts"].copy()
    printed = report.list_verdicts(verdicts, judged["claims"])
    assert all(cell in printed for cell in published.cells().index)
    assert report.find_surprises(verdicts) == []
    verdicts.loc["table2.row03.mean", "agreement"] = "differs"
    assert report.find_surprises(verdicts) == ["table2.row03.mean"]


def test_a_number_that_changes_changes_the_sentences(facts):
    claims = facts["claims"].assign(verdict="holds")
    sentences = (claims["of"] == "paper").sum()
    assert f"{sentences} hold, 0 do not, and 0 are undecided" in render(facts, claims=claims)
    some = {"logs": 20, "refused": 20, "reasons": [["wrong period", 9]]}
    assert "of none is" not in render(facts, hardware=some)
    said = render(facts, hardware=some | {"refused": 15})
    assert "of 20 public logs of other joints our sensor refuses 15" in said
    assert "of none is the backlash known" in said


def test_the_sentences_on_errors_are_what_was_measured(facts):
    claims = facts["claims"].copy()
    claims.loc["quality_decreases", "measured"] = "in rad in 3 %, in percent in 4 %"
    claims.loc["error_below_10_method", "measured"] = "7 % of our 9 tables"
    said = render(facts, claims=claims)
    assert "Growth with the backlash: in rad in 3 %, in percent in 4 %." in said
    assert "the printed ones are; 7 % of our 9 tables" in said


def test_a_number_that_agrees_weakly_is_counted_apart(facts, judged):
    verdicts = judged["verdicts"].copy()
    verdicts.loc["table2.row05.mean", "weak"] = "yes"
    weaker = report.describe(verdicts, judged["claims"], RESULTS)
    assert weaker["strong"] == facts["strong"] - 1
    assert f"{weaker['strong']} agree by our own computation" in render(weaker)


def test_the_sentence_on_the_bias_of_the_theoretical_amplitudes_follows_its_t(facts):
    assert "no bias stands out" in render(facts)
    some = facts["f"]["theoretical"] | {"t": 3.9}
    assert "a small bias that we cannot explain" in render(facts, theoretical=some)


def test_a_report_in_which_nothing_agrees_is_written(judged, facts):
    verdicts = judged["verdicts"].assign(agreement="differs", weak="")
    page = report.render(report.describe(verdicts, judged["claims"], RESULTS))[0]
    assert "numbers 0 agree by our own computation" in page
    none = {name: facts["f"][name] | {"agree": 0, "factor": []} for name in ("means", "sds")}
    assert "Intervals over a factor none say little" in render(facts, **none)


def test_every_change_of_a_rule_starts_where_the_one_before_it_ended_and_ends_at_todays_verdict(
    facts,
):
    table = published.table("deviations")
    claims = facts["claims"]
    for claim, changes in table[table["claim"] != ""].groupby("claim"):
        assert claim in claims.index
        verdicts = changes["verdict_before"].tolist()
        assert changes["verdict_after"].tolist() == [*verdicts[1:], ""]  # empty: as today
        assert set(verdicts) <= {*judging.CLAIM_VERDICTS.values()}
    for change in facts["deviations"].to_dict("records"):
        assert f"{change['before']}: *{change['verdict_before']}*" in facts["chains"][
            change["rule"]
        ] or (change["verdict_before"] == "")
    assert (table[["rule", "before", "after", "why"]] != "").all(axis=None)


def test_every_kind_of_erratum_has_its_heading(facts):
    errata = published.table("errata")
    page = render(facts)
    assert all(f"\n| {each} | " in page for each in errata.index)


# ------------------------------------------------------------------------------------------------ Table 2 as a whole


def render_evidence(facts, start=None, **changed):
    """The report with other evidence: of a start, or of all together."""
    evidence = dict(facts["f"]["evidence"])
    if start:
        starts = evidence["starts"]
        evidence["starts"] = starts | {start: starts[start] | changed}
    else:
        evidence |= changed
    return render(facts, evidence=evidence)


def test_the_first_sentence_follows_the_cells_and_the_scores_of_the_likely_start(facts):
    means, sds = facts["f"]["means"] | {"agree": 7}, facts["f"]["sds"] | {"agree": 6}
    said = render(facts, means=means, sds=sds)
    assert (
        "**If the search sees the whole record, 7 of Table 2's 10 means and 6 of its 10 SDs" in said
    )
    for excluding, words in ((0, "none of 7 scores exclude"), (1, "1 of 7 scores excludes")):
        said = render_evidence(facts, "per row", excluding=excluding, scores=7)
        assert f"the text's likely reading, {words} the table at 5 %.**" in said


def test_what_rejects_a_start_is_counted_in_its_sentence(facts):
    some = {"tests": 12, "rejected": 5, "smallest": 0.0001, "largest": 0.2}
    said = render_evidence(facts, "whole record", means=some, inside=[3.0, 8.0])
    assert (
        "3 to 8 of 10 lie in the intervals of single settings (8); rejected at 5 % by 5 of" in said
    )
    assert "p from below 0.001 to 0.2)" in said
    said = render_evidence(facts, "per fit", excluding=4, scores=7, sds=some)
    assert "*For each fit*: 4 of 7 scores exclude it." in said
    assert "and\n  5 of 12 tests; per table" in said
    said = render_evidence(facts, "per table", means=some | {"rejected": 12}, reaching=3)
    assert "*Once for the table*: 3 of " in said
    assert "per table by all of 12 tests and" in said
    few = some | {"tests": 0, "rejected": 0}
    said = render_evidence(facts, "per table", means=few)
    assert "per table by none (too few tables) of 0 tests" in said
    said = render_evidence(facts, "per row", inside=[8.0, 9.0], above=4, excluded_by="no score")
    assert "8 to 9 means lie in the intervals, but 4 above our medians." in said
    assert "it is excluded, under all settings tried, by no score" in said


def test_the_sds_hang_on_the_choices_that_differ(facts):
    for choices, words in (
        ([], "- **SDs.** "),
        (["score"], "**SDs: score decides.**"),
        (["score", "setting"], "**SDs: score and setting decide.**"),
    ):
        assert words in render_evidence(facts, sds_hang_on=choices)
    tests = facts["f"]["evidence"]["starts"]["whole record"]["sds"]
    said = render_evidence(facts, "whole record", sds_without_row_10=tests | {"rejected": 1})
    assert f"without row 10 1 of {tests['tests']} tests" in said
    p = facts["f"]["evidence"]["p"] | {"SDs": {"squares": 0.77, "ranks": 0.0031}}
    said = render_evidence(facts, p=p, least_p=0.0031)
    assert "p of the SDs is\n  0.77 by the squares of their deviations and at most 0.0031" in said
    said = render_evidence(
        facts, row10_below=300, row10_smallest=0.0123, row10_drawn=9, row10_drawn_lower=2
    )
    assert "0.0194 lies below 300 of 320 of ours (smallest: 0.0123)" in said
    assert "with a drawn start below 7 of 9." in said
