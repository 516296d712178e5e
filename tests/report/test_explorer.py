"""The pages that are played with, signature and replayed runs: what they compute and draw, by keyboard and link."""

from itertools import islice

import numpy as np
import pandas as pd
import pytest

from replication import published
from replication.characteristic import equation_10
from replication.identify import paper_search, protocol_box
from replication.replay import AGREE_RPS
from replication.search import random_normals
from replication.signature import Timing, rmse
from replication.table2 import AUTHORS_PROTOCOL, basin_labels
from workbook.checkout import RESULTS
from workbook.report.pages import load_drawn

pytestmark = pytest.mark.slow
SUPPLEMENT = RESULTS / "supplement"
STORED = pd.read_csv(SUPPLEMENT / "stored_runs.csv", index_col="run")
# What a screen shows wrongly: curves beyond the frame of their axes, and labels that are too small to read.
WRONG = """() => {
  const beyond = [...document.querySelectorAll('[data-inside]')].filter(curve => {
    const own = curve.getBBox(), frame = document.getElementById(curve.dataset.inside).getBBox();
    return own.x < frame.x - .1 || own.x + own.width > frame.x + frame.width + .1
      || own.y < frame.y - .1 || own.y + own.height > frame.y + frame.height + .1;
  });
  const small = [...document.querySelectorAll('svg text')].filter(label => {
    const {a, b} = label.getScreenCTM();
    return parseFloat(getComputedStyle(label).fontSize) * Math.hypot(a, b) < 11;
  });
  return [...beyond, ...small].map(each => each.id || each.textContent);
}"""
AT_AN_END = "each => Math.min(each.value - each.min, each.max - each.value) < 1e-3"
# All that a page shows, and in which state its controls are.
SHOWN = """[...document.querySelectorAll('main *')].map(
  each => [each.textContent, each.value, each.checked, each.getAttribute('d')])"""


def expected(T_f):
    """The misfit that the package gives to the fit of the page's record."""
    drawn = load_drawn(RESULTS, "signature_explorer")
    record, fit = np.array(drawn["record"]), np.array([*drawn["fitted"].values()][:7])
    return rmse(drawn["dt"] * np.arange(record.size), record, fit, Timing(T_f / 2, T_f, 12))


@pytest.fixture(params=["signature", "replay"])
def file(site, request):
    return site / "pages" / f"{request.param}_explorer.html"


@pytest.fixture
def explorer(tab, site):
    return tab(site / "pages" / "signature_explorer.html")


@pytest.fixture
def player(tab, site):
    return tab(site / "pages" / "replay_explorer.html")


def test_the_misfit_is_that_of_the_package_at_the_fit_and_with_the_printed_turn_period(explorer):
    for clicked, T_f in (("h1", 0.4), ("#printed", 0.408), ("#fitted", 0.4)):
        explorer.click(clicked)
        assert explorer.evaluate("rmse(state)") == pytest.approx(expected(T_f), abs=1e-9)


def test_the_backlash_shown_is_that_of_equation_10_to_the_last_digit(explorer):
    for amplitude_rps in (-1.5, -0.3825, 0, 0.4159, 1.1385):
        explorer.fill("#A-number", str(amplitude_rps))
        delta_mrad = 1e3 * equation_10().backlash_rad(abs(amplitude_rps))
        assert explorer.inner_text("#delta") == f"{delta_mrad:.4f}"


def test_a_slider_moves_by_keyboard_and_a_window_that_ends_too_early_is_told(explorer):
    before = explorer.inner_text("#rmse")
    explorer.press("#omega", "ArrowRight")
    assert explorer.inner_text("#rmse") != before
    explorer.press("#T2", "Home")
    assert "the signature is zero" in explorer.inner_text("#note")


def test_a_run_is_played_to_its_end_by_keyboard_and_ends_as_the_stored_one(player):
    run = published.authors_notebook_runs().set_index("run").loc[4]
    player.press("[value='8']", "ArrowLeft")
    player.press("[value='7']", "ArrowLeft")
    player.press("#speed", "ArrowDown")
    player.press("#play", "Enter")
    assert player.inner_text("#play") == "pause"
    player.wait_for_selector("#play:text-is('play')", timeout=60_000)
    assert player.inner_text("#at") == f"{run['iterations']:.0f} of {run['iterations']:.0f}"
    for shown in ("#best", "#printed"):
        assert float(player.inner_text(shown)) == pytest.approx(
            run["final_rmse_rps"], abs=AGREE_RPS
        )
    assert abs(float(player.inner_text("#difference"))) < AGREE_RPS
    assert f"lies in basin {STORED['basin'][4]} of " in player.inner_text("#ending")
    assert player.said == []
    assert len(player.asked) == 1


def test_all_runs_end_in_the_basin_of_the_results_and_say_which_values_are_stored(player):
    ends = pd.read_csv(SUPPLEMENT / "replay_ends.csv", index_col="run")
    basins = pd.read_csv(SUPPLEMENT / "stored_basins.csv")
    labels = basin_labels(np.r_[basins["rmse_rps"], ends["ours_rps"]])
    assert labels.max() == len(basins)
    assert player.evaluate("runs.map(run => run.ours)") == labels[len(basins) :].tolist()
    for run in (20, 21):
        player.check(f"[value='{run}']", force=True)
        player.press("#frame", "Home")
        assert (player.inner_text("#printed") == "only the end") == (run == 21)
        last = ends.loc[run]
        told = f"misfit of {last['ours_rps']:.6f} rps; the run ends after {last['our_generations']:.0f} generations"
        assert told in player.inner_text("#ending")


def test_the_page_says_first_how_many_stored_runs_miss_the_best_basin_and_their_amplitudes(player):
    missed = STORED.query("basin > 1").A_rps.abs()
    point = player.inner_text("#point")
    assert f"{len(missed)} of the {len(STORED)} runs" in point
    assert f"{missed.min():.3f} to {missed.max():.3f} rps" in point


def test_the_samples_of_every_run_can_be_told_apart_at_its_end(player):
    assert player.evaluate(
        "runs.every(({run}) => {"
        "restore({...state(), run, generation: 999}); return id('better').getBBox().width > 50; })"
    )


def test_the_samples_are_those_that_the_search_evaluated(player, record_12):
    seed = int(published.authors_notebook_runs()["cma_seed"][7])
    drawn = player.evaluate("Array.from(random.slice(0, 4200))")
    assert drawn == pytest.approx(random_normals(seed)(600, 7).ravel(), rel=1e-12)
    box = protocol_box(record_12, AUTHORS_PROTOCOL)
    for now in islice(paper_search(record_12, AUTHORS_PROTOCOL, seed), 85):
        if now.after.g not in (1, 2, 30, 85):
            continue
        player.evaluate(f"go(run.generation.indexOf({now.after.g}))")
        shares = (now.members - box.lower) / (box.upper - box.lower)
        shown = player.evaluate(f"samples(run.frames[position], {now.after.g}, [...box.keys()])")
        # Axes are kept in 1/127 standard deviation.
        assert np.abs(np.array(shown) - shares).max() < 0.02
        better = np.flatnonzero(player.evaluate("run.frames[position].better"))
        assert sorted(now.ranking[:150]) == better.tolist()
        assert player.inner_text("#best") == f"{now.misfits.min():.12f}"


def test_steps_the_slider_two_dimensions_and_the_zoom_work_by_keyboard(player):
    player.press("#on", "Enter")
    assert player.inner_text("#at").startswith("2 of ")
    player.press("#frame", "End")
    at = player.inner_text("#at")
    assert len({*at.split(" of ")}) == 1
    assert player.get_attribute("#frame", "aria-valuetext") == f"generation {at}"
    player.press("#across", "ArrowDown")  # from A to t0, which the other axis shows
    assert player.evaluate("pair()") == [1, 0]
    near = player.evaluate("id('better').getAttribute('d')")
    player.press("#zoom", "Space")
    assert player.evaluate("id('better').getAttribute('d')") != near
    player.press("#back", "Enter")
    assert player.inner_text("#at") != at


def test_a_link_restores_what_was_shown(tab, file):
    page, other = tab(file), tab(file)
    for control in page.locator("main input:not([name]), [value='5']").all():
        control.press("ArrowRight")
        control.press("Space")
    while page.evaluate("!!keeping"):  # the pages' policy forbids a function that waits
        page.wait_for_timeout(50)
    shown = page.evaluate(SHOWN)
    other.goto(page.url)
    assert other.evaluate(SHOWN) == shown
    other.reload()
    assert other.evaluate(SHOWN) == shown


@pytest.mark.parametrize("width", [390, 820, 1440])
def test_an_explorer_is_light_and_draws_within_its_axes_at_both_ends_of_every_slider(
    tab, file, width
):
    assert file.stat().st_size <= 400_000
    page = tab(file, width)
    for slider in page.locator("input[type=range]").all():
        for end in (1, slider.bounding_box()["width"] - 1):
            slider.drag_to(slider, target_position={"x": end, "y": 9})
            assert slider.evaluate(AT_AN_END)
            assert page.evaluate(WRONG) == []


def test_nothing_plays_unasked_and_less_motion_is_slower(player):
    player.wait_for_timeout(700)
    assert player.inner_text("#at").startswith("1 of ")
    assert player.input_value("#speed") == "5"
    player.emulate_media(reduced_motion="reduce")
    player.reload()
    assert player.input_value("#speed") == "2"
