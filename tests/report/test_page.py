"""The report and the notebooks' pages: everything is there, every link hits, nothing is fetched."""

import re
from html import unescape
from urllib.parse import unquote

import pytest

from replication import published
from workbook import judging
from workbook.checkout import RESULTS
from workbook.report import page


def links_and_ids(text):
    """Every link and every id of a page."""
    links = re.findall(r'<a\b[^>]*\shref="([^"]*)"', text)
    return [unescape(link) for link in links], re.findall(r'<\w+\b[^>]*\sid="([^"]*)"', text)


@pytest.fixture(scope="module")
def files(site):
    return [site / "report.html", *sorted(site.glob("pages/*.html"))]


def test_the_committed_pages_are_what_the_results_give(files, site):
    for made in files:
        committed = RESULTS / made.relative_to(site)
        assert committed.read_text("utf-8") == made.read_text("utf-8"), "run: make report"


def test_every_number_claim_and_erratum_is_on_its_page(site):
    wanted = {
        "numbers": set(published.cells().index),
        "errata": set(published.table("errata").index),
        "claims": {f"claim-{claim}" for claim in published.table("claims").index},
    }
    for name, ids in wanted.items():
        text = (site / "pages" / f"{name}.html").read_text("utf-8")
        assert ids <= set(links_and_ids(text)[1])


def test_the_main_page_is_read_in_minutes(site):
    """At most 1,500 words and 1 MB: it is the answer, the rest has pages of its own."""
    page_text = (site / "report.html").read_text("utf-8")
    assert len(page_text) < 1e6
    body = re.sub(r"<(style|script|svg)\b.*?</\1>", " ", page_text, flags=re.DOTALL)
    assert len(re.sub(r"<[^>]*>", " ", body).split()) <= 1500


def test_no_link_of_any_page_is_dead(files, site):
    found = {file: links_and_ids(file.read_text("utf-8")) for file in files}
    for file, (links, ids) in found.items():
        assert len(set(ids)) == len(ids), file.name
        for link in links:
            if link.startswith("https://"):
                continue
            address, _, anchor = unquote(link).partition("#")
            target = (file.parent / address).resolve() if address else file
            if target in found:
                assert not anchor or anchor in found[target][1], f"{file.name}: {link}"
            else:
                beside = (RESULTS / file.relative_to(site)).parent
                assert (beside / address).exists(), f"{file.name}: {link}"


def test_report_and_pages_fetch_nothing(files):
    for file in files:
        text = file.read_text("utf-8")
        assert not re.search(r'src="(https?:)?//|<link|@import', text), file.name
        assert "default-src 'none'" in text


def test_the_history_tells_of_every_rule_and_of_both_counts(verdicts):
    rendered = page.render_report(RESULTS, verdicts)
    text = " ".join(unescape(rendered["pages/history.html"]).split())
    for rule in published.table("trail")["rule"]:
        assert rule in text
    assert "First answers: 16 claims held, 9 did not, 2 were undecided" in text
    assert "92 agree" in text
    assert "2 reproduced, 1 erratum, 4 differ, 32 traced" in text


def test_text_from_the_data_is_escaped(tmp_path, replace_table):
    results = tmp_path / "results"
    (results / "outcomes").mkdir(parents=True)
    judging.collect(results)
    claims = published.table("claims")
    claims["claim"] = "<b>1 & 2</b>"
    replace_table("claims", claims)
    shown = page.render_report(results, judging.verdicts(results))["pages/claims.html"]
    assert "&lt;b&gt;1 &amp; 2&lt;/b&gt;" in shown
