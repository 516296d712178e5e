"""The report's content: everything is there, every link hits, nothing is fetched."""

import re
from collections import Counter
from html import unescape
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import pytest
from nbformat import v4

import workbook
from replication import published
from workbook import judging, provenance
from workbook.checkout import RESULTS, notebook_files
from workbook.report import cells as cells_of
from workbook.report import facts, page, pages, tables
from workbook.report.figures import load_pictures, reduce_svg

VERDICTS = judging.verdicts(RESULTS)


def links_and_ids(text):
    """Every link and every id of a page."""
    links = re.findall(r'<a\b[^>]*\shref="([^"]*)"', text)
    return map(unescape, links), re.findall(r'<\w+\b[^>]*\sid="([^"]*)"', text)


def test_the_committed_pages_are_what_the_results_give(site):
    for made in [site / "report.html", *sorted((site / "pages").glob("*.html"))]:
        committed = RESULTS / made.relative_to(site)
        assert committed.read_text(encoding="utf-8") == made.read_text(encoding="utf-8"), (
            "run: make report"
        )


def test_every_cell_claim_erratum_and_figure_is_on_the_page(report_page):
    ids = set(links_and_ids(report_page)[1])
    assert set(published.cells().index) <= ids
    assert {f"about-{cell}" for cell in published.cells().index} <= ids
    assert {f"claim-{claim}" for claim in published.claims().index} <= ids
    assert set(published.errata().index) <= ids
    drawn = load_pictures(RESULTS)
    assert {picture.name for picture in drawn if picture.element} <= ids
    assert all(f"#{picture.anchor}" in report_page for picture in drawn)


def test_every_drawing_has_its_caption_and_its_notebook():
    drawn = {picture.name: picture for picture in load_pictures(RESULTS)}
    assert set(drawn) == {path.stem for path in (workbook.ROOT / "figures").glob("*.svg")}
    for name, picture in drawn.items():
        assert len(picture.caption) > 30
        assert picture.alternative.startswith(picture.caption)
        assert f'"{name}"' in notebook_files("py")[picture.notebook].read_text(encoding="utf-8")


def marks(drawing):
    """Coordinates of a drawing's marks, and its styles but for what they refer to."""
    moved = re.sub(r'(<use [^>]*)transform="translate\((\S+) (\S+)\)"', r'\1x="\2" y="\3"', drawing)
    elements = [e for e in ElementTree.fromstring(moved).iter() if e.tag.endswith(("path", "use"))]
    placed = " ".join(e.get("d") or f"{e.get('x', 0)} {e.get('y', 0)}" for e in elements)
    styles = [re.sub(r"\s|url\(.*?\)", "", e.get("style", "")) for e in elements]
    return np.array(re.findall(r"-?[\d.]+", placed), float), styles


@pytest.mark.parametrize(
    "file", sorted((workbook.ROOT / "figures").glob("*.svg")), ids=lambda file: file.stem
)
def test_a_reduced_drawing_has_the_same_marks_within_a_tenth_of_a_point(file):
    whole = file.read_text(encoding="utf-8")
    small = reduce_svg(whole)
    assert len(small) < 0.8 * len(whole)
    (before, styles_before), (after, styles_after) = marks(whole), marks(small)
    assert np.abs(before - after).max() < 0.0501
    assert styles_before == styles_after
    known = set(re.findall(r' id="([\w-]+)"', small))
    assert set(re.findall(r'(?<=href="#)[\w-]+|(?<=url\(#)[\w-]+', small)) <= known


def test_no_link_of_any_page_is_dead(site):
    found = {
        file: links_and_ids(file.read_text(encoding="utf-8"))
        for file in [site / "report.html", *site.glob("pages/*.html")]
    }
    seen = 0
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
                committed = RESULTS / file.relative_to(site)
                assert (committed.parent / address).exists(), f"{file.name}: {link}"
            seen += 1
    assert seen > 500


def test_report_and_pages_are_light_and_fetch_nothing(site):
    total = 0
    for file in [site / "report.html", *site.glob("pages/*.html")]:
        text = file.read_text(encoding="utf-8")
        total += len(text.encode())
        assert not re.search(r'src="(https?:)?//|<link', text)
        assert "@import" not in text
        assert "default-src 'none'" in text
    assert (site / "report.html").stat().st_size < 1_000_000
    assert total < 5_000_000


def test_a_notebooks_page_has_no_script_but_the_animations_and_no_formula_left_as_it_is_typed(site):
    for file in set(site.glob("pages/*.html")) - set(site.glob("pages/*_explorer.html")):
        text = file.read_text(encoding="utf-8")
        animated = file.stem == "00_the_sensor"
        assert ("<script" in text) == ("script-src" in text) == animated, file.name
        prose = re.sub(
            r'<script>.*?</script>|<div class="code">.*?</div>|<pre>.*?</pre>|alttext="[^"]*"',
            "",
            text,
            flags=re.DOTALL,
        )
        assert not re.search(r"\$[^$<\n]{1,80}\$", prose), file.name


def test_the_findings_have_all_their_numbers_and_half_a_page():
    found = facts.fill_in_findings(facts.collect_facts(RESULTS, VERDICTS))
    assert len(found) == len(published.findings()), "a finding's number is not in the results"
    kinds, words = Counter(each["kind"] for each in found), Counter()
    for each in found:
        words[each["kind"]] += len(each["text"].split())
    assert 7 <= kinds["finding"] <= 10
    assert kinds["open"] >= 2
    assert [kinds[name] for name in ("holds", "fails", "unknown")] == [1, 1, 1]
    assert all(each["proofs"] for each in found)
    assert sum(words[kind] for kind in ("holds", "fails", "unknown")) < 150, (
        "more than the first screen holds"
    )
    assert words["finding"] + words["open"] < 450


@pytest.mark.parametrize("layout", tables.LAYOUTS, ids=lambda layout: layout["element"])
def test_a_table_has_the_papers_rows_and_columns_and_every_cell_once(layout):
    rows = tables.table_rows(layout, cells_of.judged_cells(VERDICTS))
    placed = [item.id for _, entries in rows for item in entries if isinstance(item, cells_of.Cell)]
    assert placed == list(published.cells(layout["element"]).index)
    lengths = {len(column["texts"]) for column in layout["columns"] if "texts" in column}
    assert lengths <= {len(rows)}


def test_a_bound_that_is_a_share_says_of_what():
    cells = cells_of.judged_cells(VERDICTS)
    cell = cells["table1.A.max"]
    assert cell.ours(cell.deciding) == f"{cell.deciding.reproduced:.3g} of v's range"
    other = cells["table1.tau.max"]
    assert "of" not in other.ours(other.deciding)


def test_an_exported_figure_stands_once_on_its_page(site):
    for picture in load_pictures(RESULTS):
        text = (site / "pages" / f"{picture.notebook}.html").read_text(encoding="utf-8")
        assert text.count(f'id="{picture.anchor}"') == 1, picture.name


def test_a_cells_number_is_told_with_the_digits_of_the_printed_one():
    assert cells_of.like_printed(0.48991, "0.4925") == "0.4899"
    assert cells_of.like_printed(14.0762, "8.93%") == "14.08"
    assert cells_of.like_printed(0.00225, "0.0009") == "0.00225"
    assert cells_of.like_printed(5.93e-6, "8.6983e-10") == "5.93e-06"
    assert cells_of.like_printed(float("nan"), "0.1") == ""


def test_the_authors_data_decide_a_cell_before_our_simulation():
    own = VERDICTS[VERDICTS["id"] == "table2.row10.theoretical"]
    own = own.sort_values("source", ascending=False)
    table = own.assign(verdict=["differs", "undecided"])  # by our simulation, by the authors' data
    cells = cells_of.judged_cells(table)
    assert cells["table2.row10.theoretical"].deciding.source == "authors"
    assert judging.verdict_counts(table).sum().to_dict() == {"undecided": 1}
    assert judging.verdict_counts(VERDICTS).sum().sum() == len(published.cells())


def test_text_from_the_data_is_escaped(tmp_path, monkeypatch):
    (tmp_path / "results" / "outcomes").mkdir(parents=True)
    provenance.collect(tmp_path / "results")
    claims = published.claims()
    claims["claim"] = "<b>1 & 2</b>"
    monkeypatch.setattr(published, "claims", lambda: claims)
    assert "&lt;b&gt;1 &amp; 2&lt;/b&gt;" in page.render_report(
        tmp_path / "results", tmp_path, judging.verdicts(tmp_path / "results")
    )


def test_the_sensitivity_matrix_has_the_order_of_the_paper(report_page):
    if 'id="sensitivity"' not in report_page:
        pytest.skip("not made yet: make studies NAME=sensitivity")
    head = report_page[report_page.index('<table class="matrix">') :].partition("</thead>")[0]
    names = re.findall(r'<th scope="col">([^<]+)</th>', head)[3:-2]
    kinds = [name.split()[0] for name in names]
    assert kinds == sorted(kinds, key=["Table", "Equation", "Text", "claims", "tests"].index)
    in_tables = [name for name in names if name.startswith("Table")]
    assert in_tables == sorted(in_tables)


def test_a_cells_anchor_stays_when_cells_are_added_under_another_heading():
    markdown, code = v4.new_markdown_cell, v4.new_code_cell
    cells = [
        markdown("# Title\n\n## Method"),
        code("a = 1"),
        markdown("### Table 2"),
        code("b = 2"),
    ]
    before = pages.cell_anchors(cells)
    assert before == ["method-cell-1", "method-cell-2", "table-2-cell-1", "table-2-cell-2"]
    after = pages.cell_anchors([*cells[:2], code("new = 3"), *cells[2:]])
    assert after[-2:] == before[-2:]


def test_an_exported_figure_stands_under_the_last_cell_that_assigns_it():
    sources = [
        "one = plot(1)",
        "two = plot(2)",
        "one = plot(3)",
        'workbook.export(figures={"first": (one, "x")})',
    ]
    assert pages.drawing_cells([v4.new_code_cell(source) for source in sources]) == {"first": 2}
