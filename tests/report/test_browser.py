"""The report, pages and explorers in a real browser: widths, accessibility, no request; each explorer works."""

import json
import os
import re
import subprocess
import sys
import time
from contextlib import suppress

import numpy as np
import pytest

from replication import published
from replication.signature import Timing, rmse
from studies.replay import AGREE_RPS
from workbook import lab
from workbook.checkout import RESULTS

pytestmark = pytest.mark.slow
WIDTHS = (390, 820, 1440)
PAGES = (
    "report.html",
    "pages/00_the_sensor.html",
    "pages/08_noise_table2.html",
    "pages/glossary.html",
    "pages/search.html",
    "pages/signature_explorer.html",
    "pages/replay_explorer.html",
)
OPENED = "document.querySelectorAll('details').forEach(each => each.open = true)"


@pytest.mark.parametrize("name", PAGES)
def test_a_page_opens_without_a_word_on_the_console_and_without_a_request(tab, site, name):
    page = tab(site / name)
    page.wait_for_timeout(200)
    assert page.said == []
    assert [url for url in page.asked if not url.startswith("data:")] == [(site / name).as_uri()]


@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (1440, "light")])
def test_axe_finds_no_serious_violation(tab, site, serious_violations, width, scheme):
    for name in PAGES:
        page = tab(site / name, width, scheme)
        page.evaluate(OPENED)
        page.evaluate("document.querySelector('.about')?.showPopover()")
        assert serious_violations(page) == [], name


def test_nothing_makes_a_page_wider_than_the_screen(tab, site):
    for file in [site / "report.html", *sorted(site.glob("pages/*.html"))]:
        page = tab(file)
        page.evaluate(OPENED)
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            assert page.evaluate("document.documentElement.scrollWidth") <= width, file.name


def test_a_search_finds_headings_and_terms_and_leads_to_them(tab, site):
    page = tab(site / "pages" / "05_signature_figure6.html")
    page.fill("input[type=search]", "off-basin")
    page.click("text=Search")
    assert "found" in page.inner_text("#count")
    page.click("#found a")
    assert page.url.endswith("glossary.html#off-basin-run")
    assert page.said == []


def test_the_signature_explorer_computes_the_misfit_of_the_package(tab, site):
    page = tab(site / "pages" / "signature_explorer.html")
    drawn = json.loads((RESULTS / "pages" / "signature_explorer.json").read_bytes())
    record, names = np.array(drawn["record"]), [*drawn["fitted"]][:7]
    for clicked, T_f in (("#printed", 0.408), ("#fitted", 0.4)):
        page.click(clicked)
        state = page.evaluate("state")  # with the digits that the sliders hold
        X = np.array([state[name] for name in names])
        assert pytest.approx([drawn["fitted"][name] for name in names], rel=1e-5) == X
        expected = rmse(drawn["dt"] * np.arange(record.size), record, X, Timing(T_f / 2, T_f, 12))
        assert page.evaluate("rmse(state)") == pytest.approx(expected, abs=1e-9)


def test_the_replay_explorer_plays_a_run_to_its_stored_end(tab, site):
    page = tab(site / "pages" / "replay_explorer.html")
    run = published.table("authors_notebook_runs").set_index("run").loc[8]
    page.press("#frame", "End")
    shown = float(page.inner_text("#best"))
    assert shown == pytest.approx(run["final_rmse_rps"], abs=AGREE_RPS)


@pytest.fixture
def jupyterlab(tmp_path, monkeypatch):
    """The address of a JupyterLab on copies of the notebooks."""
    pytest.importorskip("jupyterlab", reason="JupyterLab is not installed (extra `workbook`)")
    monkeypatch.setenv("JUPYTER_DATA_DIR", str(tmp_path / ".data"))  # of signatures
    lab.copy_notebooks(tmp_path)
    command = [sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", "--port=0"]
    command += [f"--ServerApp.root_dir={tmp_path}", "--IdentityProvider.token=test"]
    environment = os.environ | {"JUPYTERLAB_SETTINGS_DIR": str(tmp_path / ".settings")}
    log = tmp_path / "server.log"  # a pipe that nobody reads would fill and stop the server
    with log.open("w") as stderr:
        server = subprocess.Popen(command, stderr=stderr, env=environment)
    try:
        while not (found := re.search(r"http://127\.0\.0\.1:\d+/lab", log.read_text())):
            assert server.poll() is None, log.read_text()
            time.sleep(0.2)
        yield found[0]
    finally:
        server.terminate()
        with suppress(subprocess.TimeoutExpired):
            server.wait(timeout=20)
        server.kill()
        server.wait()


def test_the_first_notebook_opened_unrun_in_jupyterlab_shows_joint_slider_and_curves(
    browser, jupyterlab
):
    page = browser.new_page()
    page.goto(f"{jupyterlab}/tree/00_the_sensor.ipynb?token=test")
    drawn = page.locator(".jp-OutputArea svg[role=img]")
    drawn.first.wait_for(timeout=60_000)
    assert "encoder, motor, gear and load" in drawn.first.get_attribute("aria-label")
    slider = page.locator(".jp-OutputArea label:has-text('backlash') input[type=range]").first
    slider.scroll_into_view_if_needed()
    said = page.locator(".jp-OutputArea output").first
    slider.fill("0")
    before = said.inner_text()
    slider.fill("20")
    assert "2.0 mrad" in said.inner_text() != before
    curves = page.locator(".jp-OutputArea svg[role=img] path[stroke='#0072B2'][d]")
    assert curves.count() > 0
    assert page.get_by_text("get notified about official Jupyter news").count() == 0
    page.close()


def test_two_views_of_the_first_notebook_show_a_slider_each_that_moves_its_own_picture(
    browser, jupyterlab
):
    page = browser.new_page()
    page.goto(f"{jupyterlab}/tree/00_the_sensor.ipynb?token=test")
    sliders = page.locator(".jp-OutputArea label:has-text('backlash') input[type=range]")
    sliders.first.wait_for(timeout=60_000)
    in_one = sliders.count()
    page.get_by_text("File", exact=True).first.click()
    page.get_by_text("New View for Notebook").click()
    views = page.locator(".jp-NotebookPanel")
    views.nth(1).wait_for(timeout=60_000)
    for view, tenths_of_mrad in zip(views.all(), ("20", "5"), strict=True):
        own = view.locator(".jp-OutputArea label:has-text('backlash') input[type=range]")
        own.first.wait_for(state="attached", timeout=60_000)
        assert own.count() == in_one
        move = "(slider, to) => { slider.value = to; slider.dispatchEvent(new Event('input')) }"
        own.first.evaluate(move, tenths_of_mrad)
    said = [view.locator(".jp-OutputArea output").first.text_content() for view in views.all()]
    assert "2.0 mrad" in said[0]
    assert "0.5 mrad" in said[1]
    page.close()
