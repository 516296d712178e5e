"""The report and the README say what the results say, in words that follow from them."""

import math
import os
import re
import subprocess
import sys
from copy import deepcopy
from functools import reduce
from operator import getitem

import pytest

from replication import published
from replication.files import UserError
from workbook import ROOT, judging, report
from workbook.project import RESULTS

TEXT = (RESULTS / "report.md").read_text("utf-8")
README = (ROOT / "README.md").read_text("utf-8")


@pytest.fixture(scope="module")
def judged():
    return {"verdicts": judging.verdicts(), "claims": judging.claims()}


@pytest.fixture(scope="module")
def facts(judged):
    return report.describe(**judged)


def render(facts, changed=None):
    """The report with other values, by their names in what it is made from."""
    facts = facts | {"f": deepcopy(facts["f"])}
    for names, value in (changed or {}).items():
        *path, last = names.split(".")
        reduce(getitem, path, facts)[last] = value
    return report.render(facts)[0]


def test_the_committed_report_tables_and_readme_are_those_of_the_results(tmp_path):
    made = report.make_report()
    report.refuse_stale(made)
    for file in (RESULTS / "verdicts.csv", ROOT / "README.md", tmp_path / "provenance.json"):
        with pytest.raises(UserError, match=rf"{file.name}: it says other than the results"):
            report.refuse_stale(made | {file: b"other"})


@pytest.mark.parametrize(
    "absent", [{"f": {}}, {"f.why_start": {}}, {"weak": None}, {"weak": math.nan}], ids=str
)
def test_the_report_refuses_to_say_what_is_absent(facts, absent):
    with pytest.raises(UserError, match=r"run make all$"):
        render(facts, absent)


STATUS = "<!-- status: begin -->\n-\n<!-- status: end -->\n"
TEXTS = {
    "two pairs of marks": f"{STATUS}Words between.\n{STATUS}".encode(),
    "a mark between": STATUS.replace("-\n", "-\n<!-- status: begin --\n").encode(),
    "cut": STATUS.rstrip().encode(),
}


@pytest.mark.parametrize("place", ["README", "TEMPLATE"])
@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_a_damaged_readme_or_template_is_named_in_one_line(text, place, tmp_path, monkeypatch):
    file = tmp_path / "file.md"
    file.write_bytes(text if place == "README" else text.replace(b"Words", b"{% if"))
    monkeypatch.setattr(report, place, file)
    with pytest.raises(UserError, match=rf"^{file}: .*git checkout brings it back$"):
        report.make_report()


def test_every_link_of_report_and_readme_leads_to_a_file():
    for folder, text in ((RESULTS, TEXT), (ROOT, README)):
        for target in re.findall(r"\]\(([^)#]+)", text):
            assert target.startswith("http") or (folder / target).exists(), target


def test_make_check_prints_every_number_and_notices_a_new_difference(judged):
    verdicts = judged["verdicts"].copy()
    printed = report.list_verdicts(verdicts, judged["claims"])
    differing = verdicts.index[verdicts["agreement"] == "differs"]
    first = printed.partition("\n\n")[0].splitlines()
    assert first[0] == f"{len(differing)} of {len(verdicts)} printed numbers: differs"
    assert [line.split()[0] for line in first[1:]] == [*differing]
    assert all(cell in printed for cell in published.cells().index)
    assert report.find_surprises(verdicts) == []
    verdicts.loc["table2.row03.mean", "agreement"] = "differs"
    assert report.find_surprises(verdicts) == ["table2.row03.mean"]


# What is changed; what is said then, and what is not.
SAID = [
    ({"f.hardware.logs": 20, "f.hardware.refused": 15}, ["refuses 15 of 20 public logs"], []),
    (
        {"f.hardware.logs": 20, "f.hardware.refused": 20, "f.hardware.usual": 9},
        ["refuses all 20 public logs that we found, 9 because the"],
        [],
    ),
    (
        {"f.hardware.logs": 20, "f.hardware.refused": 0},
        ["refuses 0 of 20 public logs that we found."],
        [],
    ),
    (
        {
            "f.multiverse.starts.per table.reaching": 3,
            "f.multiverse.starts.per table.tables": 70,
            "f.multiverse.starts.per fit.smallest_percent": -21.2,
            "f.multiverse.starts.per fit.reaching": 5,
            "f.multiverse.starts.per fit.tables": 40,
            "f.multiverse.whole.deviation_percent": -7.24,
            "f.multiverse.printed_percent": -6.04,
            "f.multiverse.whole.means_inside": [3.0, 8.0],
            "f.multiverse.whole.row10_below": 300,
            "f.intervals.means.agree": 0,
            "f.intervals.means.width_percent": [3, 9],
            "f.intervals.sds.differ": [2, 3, 9],
            "f.intervals.sds.agree": 6,
            "f.intervals.sds.factor": [4.4, 9.6],
        },
        [
            "if one start served the whole table (3 of 70 tables come as near",
            "| once for the table | 70 |",
            "the means are 12 to 21 % too small, and",
            "and 5 of 120 tables come as near",
            "on average 7.2 % below the theoretical A (printed: 6.0 %)",
            "0 of 10 lie in our 95 % prediction intervals",
            "3 to 8 of 10 lie inside, in intervals 3 to 9 % wide",
            "rows 2 and 3 and 9 differ; row 10's is smaller than in 300 of our 320 tables",
            "; 6 of 10 SDs do",
            "an interval's upper end is 4 to 10 times its lower one",
            "as a set they fit poorly",
            "because the search then misses",
        ],
        [],
    ),
    (
        {
            "f.intervals.sds.differ": [],
            "f.multiverse.whole.sds_rejected": 0.4,
            "f.why_start.search_misses": None,
            "f.intervals.sds.factor": [],
        },
        ["- **SDs:** row 10's is smaller"],
        ["as a set they fit poorly", "because the search", "an interval's upper end"],
    ),
]


@pytest.mark.parametrize(("changed", "says", "silent"), SAID)
def test_a_number_that_changes_changes_what_is_said(facts, changed, says, silent):
    page = render(facts, changed)
    assert [words for words in says if words not in page] == []
    assert [words for words in silent if words in page] == []


def test_the_sentences_of_the_paper_are_counted_by_what_holds(facts):
    claims = facts["claims"].assign(verdict="holds")
    all_hold = f"{(claims['of'] == 'paper').sum()} hold, 0 are undecided, 0 do not hold; none"
    assert all_hold in render(facts, {"claims": claims})
    claims.loc[["local_minima", "no_backlash", "monotone"], "verdict"] = "does not hold"
    said = render(facts, {"claims": claims})
    assert "3 do not hold: on method (2) and physics (1). [We changed]" in said


def test_a_number_that_agrees_weakly_is_counted_apart(facts, judged):
    verdicts = judged["verdicts"].copy()
    verdicts.loc["table2.row05.mean", "grade"] = "agrees weakly"
    weaker = report.describe(verdicts, judged["claims"])
    assert weaker["strong"] == facts["strong"] - 1
    assert f"{weaker['strong']} agree, {weaker['weak']} weakly" in render(weaker)
    assert "| 5 | *0.6731* |" in render(weaker)


def test_a_report_in_which_nothing_agrees_is_written(judged, facts):
    verdicts = judged["verdicts"].assign(agreement="differs", grade="differs")
    page = report.render(report.describe(verdicts, judged["claims"]))[0]
    assert (
        f"0 agree, 0 weakly (a third more or less would agree, too), 0 only with each other; {len(verdicts)}"
        in page
    )


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
    assert (table[["rule", "before", "after", "why"]] != "").all(axis=None)


def test_every_kind_of_erratum_has_its_heading(facts):
    errata = published.table("errata")
    page = render(facts)
    assert all(f"\n| {each} | " in page for each in errata.index)


def test_the_first_page_and_the_readme_are_short():
    """A professor reads the README in two minutes, a reviewer the first page in ten."""
    assert len(README.split()) <= 600
    first_page = TEXT.partition("\n# Appendices\n")[0]
    assert len([word for word in first_page.split() if re.search(r"\w", word)]) <= 900


@pytest.mark.slow
def test_the_answer_in_the_readme_is_what_the_sensor_prints(tmp_path):
    printed = ""
    commands = re.findall(r"^\$ backlash (.+)$", README, re.MULTILINE)
    for command in commands:
        run = [sys.executable, "-m", "backlash", *command.split()]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        printed = subprocess.check_output(run, cwd=tmp_path, env=environment, text=True)
    answer = README.partition(f"{commands[-1]}\n")[2].partition("\n")[0]
    assert answer in printed.splitlines()
