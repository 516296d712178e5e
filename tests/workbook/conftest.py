"""A project of its own for the machine, and a real browser where one is installed."""

import shutil

import pytest

from replication.files import as_json, write_files, write_text
from workbook import ROOT, certificate, execution, outcomes, stamps
from workbook import project as project_module

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SETTINGS = f"""[tool.workbook]
packages = ["tools"]
cells = "{ROOT}/replication/data/cells.csv"
claims = "{ROOT}/replication/data/claims.csv"
kept = "tools.kept"
[tool.workbook.simulated]
variable = "BACKLASH_RECORDS"
warning = "On our simulated records."
mark = "our simulated records"
"""


@pytest.fixture
def work_on(monkeypatch):
    """Let the machine in this process work on another folder."""

    def place(folder):
        settings = project_module.read_settings(folder)
        here = {"ROOT": folder, "RESULTS": folder / "results", "SETTINGS": settings}
        here["SIMULATED"] = settings.get("simulated", {})
        for module in (project_module, certificate, execution, outcomes, stamps):
            for name, value in here.items():
                monkeypatch.setattr(module, name, value, raising=False)

    return place


@pytest.fixture
def project(tmp_path, work_on):
    """Write sources of notebooks by name; return the folder of a project, on which the machine works."""

    def write(**sources):
        folder = tmp_path / "project"
        files = {f"notebooks/{name}.py": text for name, text in sources.items()}
        files |= {"pyproject.toml": SETTINGS, "requirements.lock": "numpy==2.0\n"}
        files |= {"tools/__init__.py": ""}
        for name, text in files.items():
            write_text(folder / name, text)
        (folder / "results").mkdir(exist_ok=True)
        work_on(folder)
        return folder

    return write


@pytest.fixture
def leave_run():
    """Leave what a run of a notebook leaves: its results, by file, its record, and a stamp."""

    def leave(name, said, made, read=()):
        root = stamps.ROOT
        code = stamps.digest_code(root / "notebooks" / f"{name}.py")
        read = {each: stamps.sha256(root / each) for each in read}
        record = stamps.record_file(name)
        contents = {root / each: content for each, content in made.items()}
        write_files(contents | {record: as_json(stamps.add_record(said, code, read, made))})
        stamps.write_stamp(name, 12.3)

    return leave


@pytest.fixture(scope="session")
def browser():
    playwright = pytest.importorskip("playwright.sync_api")
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is installed")
    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def tab(browser):
    """Open a page by its address; keep what it says on the console and what it asks for outside."""
    contexts = []

    def opened(address, width=1440, scheme="light"):
        size = {"width": width, "height": 900}
        contexts.append(browser.new_context(viewport=size, color_scheme=scheme))
        page = contexts[-1].new_page()
        page.complaints, page.outside = [], []
        page.on("console", lambda line: page.complaints.append(line.text))
        page.on("pageerror", lambda error: page.complaints.append(str(error)))
        page.on("request", lambda asked: page.outside.append(asked.url))
        page.goto(address)
        return page

    yield opened
    for context in contexts:
        context.close()


@pytest.fixture
def barriers():
    """Return the accessibility rules that a page breaks, and where."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")

    def found(page):
        # Without preload axe does not read style sheets anew, which a page of a file may not.
        rules = {"runOnly": ["wcag2a", "wcag2aa", "wcag21aa"], "preload": False}
        violations = axe.Axe().run(page, options=rules).response["violations"]
        return [(each["id"], each["nodes"][0]["target"]) for each in violations]

    return found
