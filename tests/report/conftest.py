"""The report's own fixtures: the pages as the results give them, and a real browser where one is installed."""

import shutil

import pytest

from workbook import judging
from workbook.checkout import RESULTS
from workbook.report import page, pages

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
FLAGS += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]


@pytest.fixture(scope="session")
def verdicts():
    """The judged cells of the committed results."""
    return judging.verdicts(RESULTS)


@pytest.fixture(scope="session")
def site(tmp_path_factory, verdicts):
    """A folder `results` with the report and the notebooks' pages in it, rendered anew."""
    results = tmp_path_factory.mktemp("site") / "results"
    (results / "pages").mkdir(parents=True)
    rendered = page.render_report(RESULTS, verdicts) | pages.render_pages(RESULTS, verdicts)
    for file, text in rendered.items():
        (results / file).write_text(text, encoding="utf-8")
    return results


@pytest.fixture(scope="session")
def browser():
    """A browser without a screen."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not installed (extra `dev`)"
    )
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is installed")
    with playwright.sync_playwright() as running:
        opened = running.chromium.launch(executable_path=program, args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture
def tab(browser):
    """Open a file at a size, light or dark; keep what it asks for and what it says."""
    contexts = []

    def opened(file, width=1440, scheme="light", height=900):
        context = browser.new_context(
            viewport={"width": width, "height": height}, color_scheme=scheme
        )
        contexts.append(context)
        page = context.new_page()
        page.said, page.asked = [], []
        page.on("console", lambda message: page.said.append(message.text))
        page.on("pageerror", lambda error: page.said.append(str(error)))
        page.on("request", lambda request: page.asked.append(request.url))
        page.goto(file.as_uri())
        return page

    yield opened
    for context in contexts:
        context.close()


@pytest.fixture
def serious_violations():
    """What axe finds on a page that is serious: rule and place."""
    axe = pytest.importorskip(
        "axe_playwright_python.sync_playwright", reason="axe is not installed (extra `dev`)"
    )

    def found_on(page):
        found = (
            axe.Axe()
            .run(page, options={"runOnly": ["wcag2a", "wcag2aa", "wcag21aa"]})
            .response["violations"]
        )
        return [
            (each["id"], each["nodes"][0]["target"])
            for each in found
            if each["impact"] in ("serious", "critical")
        ]

    return found_on
