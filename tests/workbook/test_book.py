"""The book in a real browser: report and notebooks, at two widths, light and dark, without a network."""

import fcntl
import os
import subprocess
import sys

import pytest

from workbook import ROOT
from workbook.project import notebook_sources

pytestmark = pytest.mark.slow
NOTEBOOKS = [*notebook_sources()]
PAGES = ("results/report", f"notebooks/{NOTEBOOKS[0]}", f"notebooks/{NOTEBOOKS[5]}")
DRAWN = "[...document.images].every(image => image.complete && image.naturalWidth > 0)"


@pytest.fixture(scope="module")
def book(tmp_path_factory):
    """The book, made anew by the first of the workers that asks for it; a broken link fails."""
    folder = tmp_path_factory.getbasetemp()
    folder = (folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder) / "book"
    options = ["--quiet", "--fail-on-warning", "--conf-dir", "workbook"]
    options += ["--doctree-dir", str(folder / "doctrees"), ".", str(folder / "html")]
    folder.mkdir(exist_ok=True)
    with (folder / "made").open("a") as made:
        fcntl.flock(made, fcntl.LOCK_EX)
        if not (folder / "made").stat().st_size:
            subprocess.run([sys.executable, "-m", "sphinx", *options], cwd=ROOT, check=True)
            made.write("made\n")
    return folder / "html"


@pytest.fixture
def chapter(tab, book):
    """Open a page of the book by its name."""
    return lambda name, *size: tab((book / f"{name}.html").as_uri(), *size)


@pytest.mark.parametrize(
    ("width", "scheme"), [(390, "dark"), (390, "light"), (1440, "dark"), (1440, "light")]
)
@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_drawn_without_a_complaint_a_request_or_a_barrier(
    chapter, barriers, book, name, width, scheme
):
    page = chapter(name, width, scheme)
    page.wait_for_function(DRAWN)
    if name != PAGES[0]:
        page.wait_for_selector("mjx-container")
    assert page.locator("img").count() > 0
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert barriers(page) == []
    assert page.complaints == []
    assert [url for url in page.outside if not url.startswith((book.as_uri(), "data:"))] == []


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_no_formula_and_no_code_of_a_notebook_scrolls_sideways(chapter, name):
    page = chapter(notebook_sources()[name].relative_to(ROOT).with_suffix(""))
    page.wait_for_selector("mjx-container")
    wide = page.evaluate(
        "[...document.querySelectorAll('div.math, div.cell_input pre')]"
        ".filter(each => each.scrollWidth > each.clientWidth + 1).map(each => each.textContent)"
    )
    assert wide == []


def test_the_first_page_is_the_report_and_a_search_finds_a_term(chapter):
    page = chapter("index")
    page.wait_for_url("**/results/report.html")
    page.fill(".sidebar-search", "basin")
    page.press(".sidebar-search", "Enter")
    page.wait_for_selector("#search-results li a")
    assert "glossary" in page.inner_html("#search-results").lower()


def test_the_page_to_play_with_leads_back_to_the_book(chapter):
    page = chapter("notebooks/explore")
    page.get_by_role("link", name="To the book").click()
    page.wait_for_url("**/results/report.html")
    assert page.title()
