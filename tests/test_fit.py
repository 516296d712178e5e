from itertools import islice
from operator import attrgetter

import cma.transformations
import numpy as np
import pytest

from replication import published
from replication.bounds import from_box, into_box
from replication.cmaes import generations, random_normals
from replication.signature import Box, rmse
from replication.table2 import SearchSettings, cost, fit, search_box
from studies.todays_cma import fit_with_todays_cma
from tests.conftest import TRUE_X


def test_samples_get_into_the_box_as_the_library_of_2021_put_them(monkeypatch):
    monkeypatch.setattr(
        cma.transformations, "linquad_margin_width", cma.transformations.margin_width1
    )
    box = Box(np.array([-1.5, 0.0, 5.0, 6.28, 99.0]), np.array([1.5, 4.8, 30.0, 251.0, 101.0]))
    theirs = cma.transformations.BoxConstraintsLinQuadTransformation(
        list(zip(box.lower, box.upper, strict=True))
    )
    samples = (
        np.random.default_rng(3).uniform(-3, 4, (2000, 5)) * (box.upper - box.lower) + box.lower
    )
    np.testing.assert_array_equal(into_box(samples, box), [theirs.transform(x) for x in samples])


def test_a_point_of_the_box_comes_back_from_its_sample():
    box = Box(np.array([-1.5, 0.0, 5.0]), np.array([1.5, 0.102, 30.0]))
    points = np.random.default_rng(3).uniform(box.lower, box.upper, (500, 3))
    samples = np.array([from_box(point, box) for point in points])
    np.testing.assert_allclose(into_box(samples, box), points, rtol=1e-12, atol=1e-15)


def test_the_fit_is_the_best_member_of_the_generations_that_can_be_gone_through(made_record):
    settings = SearchSettings(population=40, iterations=25)
    box = search_box(made_record, settings)
    lowest = [
        now.misfits.min()
        for now in islice(generations(cost(made_record, settings), box, random_normals(6), 40), 25)
    ]
    assert fit(made_record, settings, 6).rmse == min(lowest)


def test_every_stored_seed_gives_its_stored_first_generation(record_12):
    for run in published.table("authors_notebook_runs").to_dict("records"):
        found = fit(record_12, SearchSettings(iterations=1), run["cma_seed"])
        assert abs(found.rmse - run["generation_1_best_rmse_rps"]) < 1e-12, run["run"]


def test_with_todays_cma_only_samples_away_from_the_bounds_agree(record_12):
    once = SearchSettings(iterations=1)
    stored = published.table("authors_notebook_runs").to_dict("records")
    off = [
        abs(
            fit_with_todays_cma(record_12, once, r["cma_seed"]).rmse
            - r["generation_1_best_rmse_rps"]
        )
        for r in stored
    ]
    same = np.array(off) < 1e-12
    assert 10 <= same.sum() < 30
    assert max(off) < 1e-2


def test_the_search_finds_the_parameters_that_a_record_was_made_with(made_record):
    fits = [fit(made_record, SearchSettings(), seed) for seed in range(1, 9)]
    best = min(fits, key=attrgetter("rmse"))
    at_truth = rmse(made_record.t, made_record.v, TRUE_X, SearchSettings().timing)
    assert best.rmse <= at_truth
    assert best.amplitude_rps == pytest.approx(abs(TRUE_X[0]), rel=0.03)
    np.testing.assert_allclose(best.X[2:5], TRUE_X[2:5], rtol=0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"iterations": 0}, "iterations 0"),
        ({"amplitude_factor": 0.0}, "the box is empty"),
        ({"T_d": 0.0}, "must lie above 0"),
        ({"T_f": 9.0}, "shorter than one turn"),
    ],
)
def test_settings_that_cannot_be_searched_with_are_one_clear_error(made_record, change, words):
    with pytest.raises(ValueError, match=words):
        fit(made_record, SearchSettings(**change), 1)
