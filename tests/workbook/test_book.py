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
def tab(browser, book):
    """Open a page of the book; keep what it says on the console and what it asks for outside."""
    contexts = []

    def opened(name, width=1440, scheme="light"):
        size = {"width": width, "height": 900}
        contexts.append(browser.new_context(viewport=size, color_scheme=scheme))
        page = contexts[-1].new_page()
        page.complaints, page.outside = [], []
        page.on("console", lambda line: page.complaints.append(line.text))
        page.on("pageerror", lambda error: page.complaints.append(str(error)))
        page.on("request", lambda asked: page.outside.append(asked.url))
        page.goto((book / f"{name}.html").as_uri())
        return page

    yield opened
    for context in contexts:
        context.close()


@pytest.mark.parametrize(
    ("width", "scheme"), [(390, "dark"), (390, "light"), (1440, "dark"), (1440, "light")]
)
@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_drawn_without_a_complaint_a_request_or_a_barrier(tab, book, name, width, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    page = tab(name, width, scheme)
    page.wait_for_function(DRAWN)
    if name != PAGES[0]:
        page.wait_for_selector("mjx-container")
    assert page.locator("img").count() > 0
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    # Without preload axe does not read style sheets anew, which a page of a file may not.
    rules = {"runOnly": ["wcag2a", "wcag2aa", "wcag21aa"], "preload": False}
    violations = axe.Axe().run(page, options=rules).response["violations"]
    assert [(each["id"], each["nodes"][0]["target"]) for each in violations] == []
    assert page.complaints == []
    assert [url for url in page.outside if not url.startswith((book.as_uri(), "data:"))] == []


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_no_formula_and_no_code_of_a_notebook_scrolls_sideways(tab, name):
    page = tab(notebook_sources()[name].relative_to(ROOT).with_suffix(""))
    page.wait_for_selector("mjx-container")
    wide = page.evaluate(
        "[...document.querySelectorAll('div.math, div.cell_input pre')]"
        ".filter(each => each.scrollWidth > each.clientWidth + 1).map(each => each.textContent)"
    )
    assert wide == []


def test_the_first_page_is_the_report_and_a_search_finds_a_term(tab):
    page = tab("index")
    page.wait_for_url("**/results/report.html")
    page.fill(".sidebar-search", "basin")
    page.press(".sidebar-search", "Enter")
    page.wait_for_selector("#search-results li a")
    assert "glossary" in page.inner_html("#search-results").lower()
