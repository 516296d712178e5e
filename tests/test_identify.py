from dataclasses import replace

import cma
import cma.transformations
import numpy as np
import pytest

from replication import datasets, published
from replication.compiled.misfit import population_rmse
from replication.identify import (
    Protocol,
    evolution_strategy,
    first_generation_rmse,
    into_box,
    margin_cma3,
    margin_cma4,
    paper_fit,
    protocol_box,
)
from replication.signature import signature

MARGINS = {margin_cma3: cma.transformations.margin_width1, margin_cma4: cma.transformations.margin_width2}
TRUE_X = np.array([-0.6, 0.012, 15.0, 134.0, 100.0, 0.1507, 0.0113])


@pytest.fixture(scope="module")
def made_record():
    base = datasets.constant_speed(samples=2401, dt=0.002)
    clean = replace(base, v=base.v + signature(base.t, TRUE_X, Protocol().timing))
    return datasets.add_uniform_noise(clean, 0.05, np.random.default_rng(5))


@pytest.mark.parametrize("margin", MARGINS)
def test_samples_and_their_images_are_those_of_cma_with_its_own_bounds(made_record, margin, monkeypatch):
    monkeypatch.setattr(cma.transformations, "linquad_margin_width", MARGINS[margin])
    protocol = Protocol(margin=margin, population=30, iterations=40)
    box = protocol_box(made_record, protocol)
    width = box.upper - box.lower
    options = {"popsize": 30, "maxiter": 40, "seed": 7, "bounds": [box.lower, box.upper], "CMA_stds": width / 4}
    theirs = cma.CMAEvolutionStrategy((box.lower + box.upper) / 2, 1, options | {"verbose": -9, "verb_log": 0})
    ours = evolution_strategy(box, protocol, seed=7)
    while not theirs.stop():
        expected, genotypes = np.array(theirs.ask()), ours.ask()
        np.testing.assert_array_equal(into_box(np.array(genotypes), box, margin), expected)
        misfits = population_rmse(made_record.t, made_record.v, expected, protocol.timing)
        theirs.tell(list(expected), misfits)
        ours.tell(genotypes, misfits, check_points=False)
    assert ours.countiter == 40


def test_the_global_random_state_is_left_alone(made_record):
    np.random.seed(3)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    first_generation_rmse(made_record, Protocol(), seed=11)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


def test_every_stored_seed_gives_its_stored_first_generation_with_the_margins_of_old_cma(record_12):
    for run in published.authors_notebook_runs().to_dict("records"):
        found = first_generation_rmse(record_12, Protocol(), run["cma_seed"])
        assert abs(found - run["generation_1_best_rmse_rps"]) < 1e-12, run["run"]


def test_with_the_margins_of_newer_cma_only_samples_away_from_the_bounds_agree(record_12):
    newer = Protocol(margin=margin_cma4)
    stored = published.authors_notebook_runs().to_dict("records")
    off = [
        abs(first_generation_rmse(record_12, newer, r["cma_seed"]) - r["generation_1_best_rmse_rps"]) for r in stored
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


def test_a_seed_gives_the_same_fit_twice(made_record):
    protocol = Protocol(population=40, iterations=30)
    first, second = (paper_fit(made_record, protocol, seed=4) for _ in range(2))
    np.testing.assert_array_equal(first.X, second.X)
    assert (first.rmse, first.evaluations) == (second.rmse, second.evaluations)


def test_every_fit_lies_in_the_box(made_record):
    protocol = Protocol(population=20, iterations=15)
    box = protocol_box(made_record, protocol)
    for seed in range(1, 20):
        fit = paper_fit(made_record, protocol, seed)
        assert (box.lower <= fit.X).all()
        assert (box.upper >= fit.X).all()


def test_seed_zero_is_refused_because_cma_takes_it_for_the_clock(made_record):
    with pytest.raises(ValueError, match="seed 0"):
        paper_fit(made_record, Protocol(), seed=0)
