"""Notebooks in a project of their own, and a real browser where one is installed."""

import os
import shutil
from unittest import mock

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture
def project(tmp_path):
    """Write sources of notebooks by name; return the folder that holds `notebooks`."""

    def write(**sources):
        (tmp_path / "notebooks").mkdir(exist_ok=True)
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
