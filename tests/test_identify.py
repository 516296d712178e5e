import cma
import cma.transformations
import numpy as np
import pytest

from replication import published
from replication.compiled.bounds import from_box, into_box, margin_2021, margin_today
from replication.compiled.misfit import fold, folded_rmse, population_rmse
from replication.identify import Protocol, library_search, paper_fit, paper_search, protocol_box
from replication.signature import Box
from tests.conftest import TRUE_X

MARGINS = {
    margin_2021: cma.transformations.margin_width1,
    margin_today: cma.transformations.margin_width2,
}


@pytest.mark.parametrize("margin", MARGINS)
def test_samples_get_into_the_box_as_the_library_puts_them(margin, monkeypatch):
    monkeypatch.setattr(cma.transformations, "linquad_margin_width", MARGINS[margin])
    box = Box(np.array([-1.5, 0.0, 5.0, 6.28, 99.0]), np.array([1.5, 4.8, 30.0, 251.0, 101.0]))
    theirs = cma.transformations.BoxConstraintsLinQuadTransformation(
        list(zip(box.lower, box.upper, strict=True))
    )
    samples = (
        np.random.default_rng(3).uniform(-3, 4, (2000, 5)) * (box.upper - box.lower) + box.lower
    )
    np.testing.assert_array_equal(
        into_box(samples, box, margin), [theirs.transform(x) for x in samples]
    )


@pytest.mark.parametrize("margin", MARGINS)
def test_a_point_of_the_box_comes_back_from_its_sample(margin):
    box = Box(np.array([-1.5, 0.0, 5.0]), np.array([1.5, 0.102, 30.0]))
    points = np.random.default_rng(3).uniform(box.lower, box.upper, (500, 3))
    samples = np.array([from_box(point, box, margin) for point in points])
    np.testing.assert_allclose(into_box(samples, box, margin), points, rtol=1e-12, atol=1e-15)


def test_todays_library_is_followed_exactly_without_its_slow_bounds(made_record):
    protocol = Protocol(engine="cma", population=30, iterations=40)
    box = protocol_box(made_record, protocol)
    width = box.upper - box.lower
    options = {
        "popsize": 30,
        "maxiter": 40,
        "seed": 7,
        "bounds": [box.lower, box.upper],
        "CMA_stds": width / 4,
    }
    theirs = cma.CMAEvolutionStrategy(
        (box.lower + box.upper) / 2, 1, options | {"verbose": -9, "verb_log": 0}
    )
    ours = library_search(made_record, protocol, seed=7)
    record = fold(made_record.t, made_record.v, protocol.timing)
    while not theirs.stop():
        expected, samples = np.array(theirs.ask()), ours.ask()
        np.testing.assert_array_equal(into_box(np.array(samples), box, margin_today), expected)
        misfits = folded_rmse(expected, record)
        theirs.tell(list(expected), misfits)
        ours.tell(samples, misfits, check_points=False)
    assert ours.countiter == 40
    fit = paper_fit(made_record, protocol, seed=7)
    assert (fit.rmse, fit.iterations, fit.evaluations) == (theirs.best.f, 40, 1200)


def test_both_engines_search_but_not_alike(made_record):
    library = Protocol(engine="cma", iterations=30)
    assert (
        paper_fit(made_record, library, 3).rmse
        != paper_fit(made_record, Protocol(iterations=30), 3).rmse
    )
    with pytest.raises(ValueError, match="engine 'cmaes'"):
        paper_fit(made_record, Protocol(engine="cmaes"), 3)


def test_the_fit_is_the_best_member_of_the_generations_that_can_be_gone_through(made_record):
    protocol = Protocol(population=40, iterations=25)
    lowest = [
        now.misfits.min()
        for now, _ in zip(paper_search(made_record, protocol, 6), range(25), strict=False)
    ]
    assert paper_fit(made_record, protocol, 6).rmse == min(lowest)


def test_every_stored_seed_gives_its_stored_first_generation(record_12):
    for run in published.table("authors_notebook_runs").to_dict("records"):
        found = paper_fit(record_12, Protocol(iterations=1), run["cma_seed"])
        assert abs(found.rmse - run["generation_1_best_rmse_rps"]) < 1e-12, run["run"]


def test_with_todays_cma_only_samples_away_from_the_bounds_agree(record_12):
    newer = Protocol(engine="cma", iterations=1)
    stored = published.table("authors_notebook_runs").to_dict("records")
    off = [
        abs(paper_fit(record_12, newer, r["cma_seed"]).rmse - r["generation_1_best_rmse_rps"])
        for r in stored
    ]
    same = np.array(off) < 1e-12
    assert 10 <= same.sum() < 30
    assert max(off) < 1e-2


def test_the_search_finds_the_parameters_that_a_record_was_made_with(made_record):
    fits = [paper_fit(made_record, Protocol(), seed) for seed in range(1, 9)]
    best = min(fits, key=lambda fit: fit.rmse)
    at_truth = population_rmse(made_record.t, made_record.v, TRUE_X[None], Protocol().timing)[0]
    assert best.rmse <= at_truth
    assert best.amplitude_rps == pytest.approx(abs(TRUE_X[0]), rel=0.03)
    np.testing.assert_allclose(best.X[2:5], TRUE_X[2:5], rtol=0.05)


@pytest.mark.parametrize("engine", ["2021", "cma"])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"population": 3}, "population 3"),
        ({"iterations": 0}, "iterations 0"),
        ({"amplitude_factor": 0.0}, "the box is empty"),
        ({"amplitude_factor": -1.0}, "the box is empty"),
        ({"T_d": 0.0}, "must lie above 0"),
        ({"T_f": -0.4}, "must lie above 0"),
        ({"T_f": 9.0}, "shorter than one turn"),
    ],
)
def test_settings_that_cannot_be_searched_with_are_one_clear_error(
    made_record, engine, change, words
):
    with pytest.raises(ValueError, match=words):
        paper_fit(made_record, Protocol(engine=engine, **change), 1)


@pytest.mark.parametrize("engine", ["2021", "cma"])
def test_seed_zero_is_refused_because_cma_takes_it_for_the_clock(made_record, engine):
    with pytest.raises(ValueError, match="seed 0"):
        paper_fit(made_record, Protocol(engine=engine), seed=0)
