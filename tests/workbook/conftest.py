"""A project of its own for the machine, and a real browser where one is installed."""

import os
import shutil
from unittest import mock

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SETTINGS = (
    '[tool.workbook]\npackages = ["tools"]\nfolders = ["BACKLASH_DATA"]\nkept = "tools.kept"\n'
)


@pytest.fixture
def project(tmp_path):
    """Write sources of notebooks by name; return the folder of a project that holds `notebooks`."""

    def write(**sources):
        for name in ("notebooks", "tools", "results"):
            (tmp_path / name).mkdir(exist_ok=True)
        (tmp_path / "pyproject.toml").write_text(SETTINGS)
        (tmp_path / "requirements.lock").write_text("numpy==2.0\n")
        (tmp_path / "tools" / "__init__.py").touch()
        for name, text in sources.items():
            (tmp_path / "notebooks" / f"{name}.py").write_text(text, "utf-8")
        return tmp_path

    with mock.patch.dict(os.environ):  # which a run changes
        yield write


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
