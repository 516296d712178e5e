"""The report's own fixtures: the pages as the results give them, and a real browser where one is installed."""

import shutil

import pytest

from workbook import judging
from workbook.checkout import NOTEBOOKS, RESULTS
from workbook.report import page, pages

VERDICTS = judging.verdicts(RESULTS)
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
FLAGS += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]


@pytest.fixture(scope="session")
def report_page():
    """The report, rendered anew."""
    return page.render_report(RESULTS, NOTEBOOKS, VERDICTS)


@pytest.fixture(scope="session")
def site(tmp_path_factory, report_page):
    """A folder `results` with the report and the notebooks' pages in it."""
    root = tmp_path_factory.mktemp("site")
    results = root / "results"
    (results / "pages").mkdir(parents=True)
    (results / "report.html").write_text(report_page, encoding="utf-8")
    for name, text in pages.render_pages(RESULTS, NOTEBOOKS, VERDICTS).items():
        (results / "pages" / f"{name}.html").write_text(text, encoding="utf-8")
    return results


@pytest.fixture(scope="session")
def browser():
    """A browser without a screen."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra `dev`)")
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is installed")
    with playwright.sync_playwright() as running:
        opened = running.chromium.launch(executable_path=program, args=FLAGS)
        yield opened
        opened.close()
