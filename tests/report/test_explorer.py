"""The page with the signature over a log: what it computes, and how it is played."""

import pandas as pd
import pytest
from places import RESULTS

from replication.signature import Timing, rmse

X = ["A", "t0", "tau", "omega", "v_t", "T2", "T1"]


def expected(fit, T_f):
    log = pd.read_csv(RESULTS / "start_log.csv")
    t = 0.002 * pd.RangeIndex(len(log)).to_numpy()
    return rmse(t, log["speed_rps"].to_numpy(), fit[X].to_numpy(), Timing(T_f / 2, T_f, 12))


@pytest.fixture
def explorer(browser, site):
    page = browser.new_page()
    page.asked = []
    page.on("request", lambda request: page.asked.append(request.url))
    page.goto((site / "pages" / "signature_explorer.html").as_uri())
    yield page
    page.close()


@pytest.mark.slow
def test_the_misfit_is_that_of_the_package_at_the_fit_and_with_the_printed_turn_period(explorer):
    fit = pd.read_csv(RESULTS / "start_fit.csv").iloc[0]
    assert explorer.evaluate("rmse(parameters())") == pytest.approx(expected(fit, 0.4), abs=1e-9)
    explorer.click("#printed")
    assert explorer.evaluate("rmse(parameters())") == pytest.approx(expected(fit, 0.408), abs=1e-9)
    explorer.click("#fitted")
    assert explorer.evaluate("rmse(parameters())") == pytest.approx(expected(fit, 0.4), abs=1e-9)
    assert len(explorer.asked) == 1


@pytest.mark.slow
def test_a_slider_moves_by_keyboard_and_the_misfit_with_it(explorer):
    before = explorer.inner_text("#rmse")
    explorer.focus("#omega")
    for _ in range(5):
        explorer.keyboard.press("ArrowRight")
    assert explorer.inner_text("#rmse") != before


@pytest.mark.slow
def test_axe_finds_no_serious_violation_on_the_explorer(explorer):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed (extra `dev`)")
    found = axe.Axe().run(explorer, options={"runOnly": ["wcag2a", "wcag2aa"]}).response["violations"]
    assert [each["id"] for each in found if each["impact"] in ("serious", "critical")] == []
