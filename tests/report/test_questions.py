"""The questions of a reviewer: each is answered by the report in at most two clicks and two screens."""

import csv
import re
from pathlib import Path

import pytest

from workbook import judging
from workbook.checkout import RESULTS
from workbook.report import cells, facts, page

VERDICTS = judging.verdicts(RESULTS)
QUESTIONS = list(csv.DictReader(Path(__file__).with_name("questions.csv").open(encoding="utf-8")))
SCREENS = 2


@pytest.fixture(scope="module")
def numbers():
    """What the answers must say, by name: from the results, not typed."""
    differing = [
        cell
        for cell in cells.judged_cells(VERDICTS).values()
        if re.match(r"table2.*(mean|sd)$", cell.id) and cell.deciding.disagreement >= 0
    ]
    largest = max(differing, key=lambda cell: cell.deciding.disagreement)
    unpublished = r"table[34]|table2\.row(01\.(?!noise)|11)"  # row 1's noise is in a public record
    resting = VERDICTS[VERDICTS["id"].str.match(unpublished)]
    return facts.collect_facts(RESULTS, VERDICTS) | {
        "largest": largest.id,
        "largest_printed": f"printed {largest.printed}, ours {largest.ours(largest.deciding)}",
        "largest_reason": largest.deciding.reason,
        "threshold": largest.deciding.reason.rpartition("; ")[2],
        "unpublished": resting["id"].nunique(),
        "unpublished_rows": len(resting),
        "misfit_line": page.code_line("signature.rmse").replace("#L", ", line "),
    }


def screens_down(element, height):
    """How many screens below the top of the window the end of an element is."""
    box = element.bounding_box()
    assert box, "it is not shown"
    assert box["y"] >= 0, "it is above what is shown"
    return (box["y"] + box["height"]) / height


@pytest.mark.slow
@pytest.mark.parametrize(("width", "height"), [(1440, 900), (390, 844)])
@pytest.mark.parametrize("asked", QUESTIONS, ids=lambda asked: asked["question"])
def test_a_question_is_answered_after_one_click_and_its_evidence_after_two(
    tab, site, numbers, asked, width, height
):
    opened = tab(site / "report.html", width, height=height)
    first = opened.locator("nav.contents a", has_text="Questions")
    assert screens_down(first, height) <= 1
    first.click()
    entry = opened.locator(".questions > div").filter(
        has=opened.locator("dt", has_text=asked["question"])
    )
    assert asked["answer"].format_map(numbers) in entry.inner_text()
    assert screens_down(entry, height) <= SCREENS
    entry.locator(asked["click"].format_map(numbers)).first.click()
    opened.wait_for_timeout(100)
    evidence = opened.locator(asked["evidence"].format_map(numbers)).first
    assert asked["shows"].format_map(numbers) in evidence.inner_text()
    assert screens_down(evidence, height) <= SCREENS


def test_every_question_is_asked_once(report_page):
    assert len(QUESTIONS) >= 9
    for asked in QUESTIONS:
        assert report_page.count(f"<dt>{asked['question'].replace(chr(39), '&#39;')}</dt>") == 1


@pytest.mark.slow
@pytest.mark.parametrize(("width", "height"), [(1440, 900), (390, 844)])
def test_a_picture_is_on_the_first_screen_before_the_thirteenth_stop(tab, site, width, height):
    opened = tab(site / "report.html", width, height=height)
    assert screens_down(opened.locator("#sensor svg"), height) <= 1
    before = """[...document.querySelectorAll("a[href], button, select, summary, [tabindex='0']")].filter(each =>
        each.compareDocumentPosition(document.getElementById("sensor")) & 4).length"""
    assert opened.evaluate(before) <= 12
