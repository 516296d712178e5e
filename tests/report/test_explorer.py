"""The pages that are played with, the signature over a log and the replayed runs: what they compute, by keyboard."""

import json
from itertools import islice

import numpy as np
import pandas as pd
import pytest

from replication import published
from replication.identify import paper_search, protocol_box
from replication.replay import AGREE_RPS
from replication.search import random_normals
from replication.signature import Timing, rmse
from replication.table2 import AUTHORS_PROTOCOL, basin_labels
from workbook.checkout import RESULTS

SUPPLEMENT = RESULTS / "supplement"
X = ["A", "t0", "tau", "omega", "v_t", "T2", "T1"]


def expected(T_f):
    """The misfit that the package gives to the fit of the page's record."""
    drawn = json.loads((RESULTS / "pages" / "signature_explorer.json").read_text(encoding="utf-8"))
    record, fit = np.array(drawn["record"]), [drawn["fitted"][name] for name in X]
    return rmse(
        drawn["dt"] * np.arange(record.size), record, np.array(fit), Timing(T_f / 2, T_f, 12)
    )


@pytest.fixture
def explorer(tab, site):
    return tab(site / "pages" / "signature_explorer.html")


@pytest.fixture
def player(tab, site):
    return tab(site / "pages" / "replay_explorer.html")


@pytest.mark.slow
def test_the_misfit_is_that_of_the_package_at_the_fit_and_with_the_printed_turn_period(explorer):
    assert explorer.evaluate("rmse(parameters())") == pytest.approx(expected(0.4), abs=1e-9)
    explorer.click("#printed")
    assert explorer.evaluate("rmse(parameters())") == pytest.approx(expected(0.408), abs=1e-9)
    explorer.click("#fitted")
    assert explorer.evaluate("rmse(parameters())") == pytest.approx(expected(0.4), abs=1e-9)
    assert len(explorer.asked) == 1


@pytest.mark.slow
def test_a_slider_moves_by_keyboard_and_the_misfit_with_it(explorer):
    before = explorer.inner_text("#rmse")
    explorer.focus("#omega")
    for _ in range(5):
        explorer.keyboard.press("ArrowRight")
    assert explorer.inner_text("#rmse") != before


@pytest.mark.slow
def test_a_run_is_played_to_its_end_by_keyboard_and_ends_as_the_stored_one(player):
    run = published.authors_notebook_runs().set_index("run").loc[4]
    player.focus("#run")
    for _ in range(4):  # from run 8
        player.keyboard.press("ArrowUp")
    player.focus("#speed")
    player.keyboard.press("ArrowDown")
    player.focus("#play")
    player.keyboard.press("Enter")
    assert player.inner_text("#play") == "pause"
    player.get_by_role("button", name="play", exact=True).wait_for(timeout=60_000)
    assert player.inner_text("#at") == f"{run['iterations']:.0f} of {run['iterations']:.0f}"
    assert float(player.inner_text("#best")) == pytest.approx(run["final_rmse_rps"], abs=AGREE_RPS)
    assert float(player.inner_text("#printed")) == pytest.approx(
        run["final_rmse_rps"], abs=AGREE_RPS
    )
    assert abs(float(player.inner_text("#difference"))) < AGREE_RPS
    basin = pd.read_csv(SUPPLEMENT / "stored_runs.csv").set_index("run")["basin"][4]
    assert f"lies in basin {basin} of " in player.inner_text("#ending")
    assert player.said == []
    assert len(player.asked) == 1


@pytest.mark.slow
def test_all_runs_end_in_the_basin_of_the_results_and_say_which_values_are_stored(player):
    ends, basins = (
        pd.read_csv(SUPPLEMENT / f"{name}.csv") for name in ("replay_ends", "stored_basins")
    )
    labels = basin_labels(np.r_[basins["rmse_rps"], ends["ours_rps"]])
    assert labels.max() == len(basins)
    assert player.evaluate("runs.map(run => run.ours)") == labels[len(basins) :].tolist()
    for run in (20, 21):
        player.select_option("#run", str(run))
        player.press("#frame", "Home")
        assert (player.inner_text("#printed") == "only the end") == (run == 21)
        last = ends.set_index("run").loc[run]
        told = f"misfit of {last['ours_rps']:.6f} rps; the run ends after {last['our_generations']:.0f} generations"
        assert told in player.inner_text("#ending")


@pytest.mark.slow
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
        for pair in ([0, 1], [2, 3], [5, 6], [4, 1]):
            shown = player.evaluate(f"samples(run.frames[position], {now.after.g}, {pair})")
            # Axes are kept in 1/127 standard deviation.
            assert np.abs(np.array(shown) - shares[:, pair]).max() < 0.02
        better = np.flatnonzero(player.evaluate("run.frames[position].better"))
        assert sorted(now.ranking[:150]) == better.tolist()
        assert player.inner_text("#best") == f"{now.misfits.min():.12f}"


@pytest.mark.slow
def test_steps_the_slider_two_dimensions_and_the_zoom_work_by_keyboard(player):
    assert player.inner_text("#at").startswith("1 of ")
    player.focus("#on")
    player.keyboard.press("Enter")
    assert player.inner_text("#at").startswith("2 of ")
    player.focus("#frame")
    player.keyboard.press("End")
    at = player.inner_text("#at").split(" of ")
    assert at[0] == at[1]
    assert player.get_attribute("#frame", "aria-valuetext") == "generation {} of {}".format(*at)
    player.focus("#across")
    player.keyboard.press("ArrowDown")  # from A to t0, which the other axis shows
    assert player.evaluate("pair()") == [1, 0]
    far = player.evaluate("id('better').getAttribute('d')")
    player.focus("#zoom")
    player.keyboard.press("Space")
    assert player.evaluate("id('better').getAttribute('d')") != far
    player.focus("#back")
    player.keyboard.press("Enter")
    assert player.inner_text("#at") != " of ".join(at)


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (820, "light"), (1440, "dark")])
@pytest.mark.parametrize("name", ["signature", "replay"])
def test_axe_finds_no_serious_violation_on_an_explorer(
    tab, site, serious_violations, name, width, scheme
):
    page = tab(site / "pages" / f"{name}_explorer.html", width, scheme)
    assert serious_violations(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.slow
def test_nothing_plays_unasked_and_less_motion_is_slower(player):
    player.wait_for_timeout(700)
    assert player.inner_text("#at").startswith("1 of ")
    assert player.input_value("#speed") == "5"
    player.emulate_media(reduced_motion="reduce")
    player.reload()
    assert player.input_value("#speed") == "2"


def test_an_explorer_is_light(site):
    for file in site.glob("pages/*_explorer.html"):
        assert file.stat().st_size <= 400_000, file.name
