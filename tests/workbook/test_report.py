"""The report and the README say what the results say, in words that follow from them."""

import math
import re

import numpy as np
import pytest

from replication import published, table2
from replication.files import UserError
from workbook import ROOT, evidence, judging, report
from workbook.outcomes import RESULTS

TEXT = (RESULTS / "report.md").read_text("utf-8")
README = (ROOT / "README.md").read_text("utf-8")


@pytest.fixture(scope="module")
def facts():
    return report.describe(judging.verdicts(RESULTS), judging.claims(RESULTS), RESULTS)


def render(facts, **changed):
    return report.render(facts | changed)[0]


def test_the_committed_report_and_readme_are_those_of_the_results(facts):
    page, status = report.render(facts)
    assert page == TEXT
    assert f"-->\n{status}\n<!--" in README


@pytest.mark.parametrize(
    "absent", [{"f": {}}, {"hardware": None}, {"changed": None}, {"changed": math.nan}], ids=str
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
    with pytest.raises(UserError, match="no notebook has computed it"):
        report.write_report(tmp_path, ROOT / "README.md")
    assert not written


def test_every_link_of_report_and_readme_leads_to_a_file():
    for folder, text in ((RESULTS, TEXT), (ROOT, README)):
        for target in re.findall(r"\]\(([^)#]+)", text):
            assert target.startswith("http") or (folder / target).exists(), target


def test_make_check_prints_every_number_and_notices_a_new_difference():
    verdicts = judging.verdicts(RESULTS)
    printed = report.list_numbers(verdicts)
    assert all(cell in printed for cell in published.cells().index)
    assert report.find_surprises(verdicts) == []
    verdicts.loc[verdicts["id"] == "table2.row03.mean", "agreement"] = "differs"
    assert report.find_surprises(verdicts) == ["table2.row03.mean"]


def test_a_number_that_changes_changes_the_sentences(facts):
    means = facts["means"] | {"agree": 7}
    assert "7 of 10 printed means" in render(facts, means=means)
    claims = facts["claims"].assign(verdict="holds")
    assert f"{len(claims)} hold, 0 do not, and 0 are undecided" in render(facts, claims=claims)
    for p, sentence in ((0.01, "do not agree as a whole"), (0.3, "as a whole are neither")):
        whole = facts["evidence"]["whole"] | {"p_sds": p}
        said = render(facts, evidence=facts["evidence"] | {"whole": whole})
        assert f"SDs {sentence}" in said
    some = {"logs": 20, "refused": 20, "reasons": [("wrong period", 9)]}
    assert "of none is" not in render(facts, hardware=some)
    said = render(facts, hardware=some | {"refused": 15})
    assert "of 20 public logs of other joints our sensor refuses 15" in said
    assert "of none is the backlash known" in said


# ------------------------------------------------------------------------------------------------ Table 2 as a whole


@pytest.fixture(scope="module")
def whole():
    realisations = table2.read_realisations(RESULTS / "table2_realisations.csv")
    return realisations[~evidence.starts_drawn(realisations)]


def test_p_as_a_whole_is_uniform_among_our_own_tables(whole):
    """Tables put together from ours row by row, judged like the printed one: about a tenth have p below 0.1."""
    means, _ = evidence.tables(whole)
    rng = np.random.default_rng(3)
    p = []
    for _ in range(150):
        left = rng.permuted(means, axis=1)
        p.append(evidence.joint_p(evidence.mean_scores(left)))
    assert 0.02 <= np.mean(np.array(p) < 0.1) <= 0.20
    assert 0.40 <= np.mean(np.array(p) < 0.5) <= 0.65


def test_a_table_that_is_off_is_rejected(whole):
    means, sds = evidence.tables(whole)
    printed = evidence.printed_table()
    for factor in (0.93, 1.07):
        off = np.hstack([factor * printed.means, means])
        assert evidence.joint_p(evidence.mean_scores(off)) < 0.01
        assert evidence.bias_p(means, factor * printed.means) < 0.01
    assert evidence.joint_p(evidence.rank_scores(np.hstack([20 * printed.sds, sds]))) < 0.01
