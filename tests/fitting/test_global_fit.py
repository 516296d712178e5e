from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from backlash.fitting.folding import factorise
from backlash.fitting.global_fit import global_fit
from backlash.fitting.readings import amplitude_of_mean_turn, protocol_for
from replication import table2
from replication.records import Recording, add_noise, from_sample
from replication.signature import rmse, signature
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings
from replication.records import load_clean, load_noisy
from replication.table2 import SearchSettings, search_box
from tests.conftest import TRUE_X, signature_record
from tests.processors import kernels_here, printed

PROTOCOL = SearchSettings()


def drawn(seed, dt=0.002, turn_s=0.4, turns=12, noise=0.0):
    """A signature in the box that its record gives, that record with noise, and the box's settings."""
    generator = np.random.default_rng([seed, 0, 0])
    t = dt * np.arange(int(turns * turn_s / dt) + 1)
    empty = Recording(t, t, 100.0, turn_s, "made")
    protocol = protocol_for(empty)
    while True:
        start = generator.uniform(0, 0.9 * turn_s)
        end = start + generator.uniform(0.08, 0.45) * turn_s
        t0 = start - generator.uniform(0, min(start, 0.15 * turn_s))
        A, tau = generator.choice([-1, 1]) * generator.uniform(0.3, 1.5), generator.uniform(5, 30)
        X = np.array(
            [A, t0, tau, generator.uniform(8 * np.pi, 80 * np.pi), 100.0, end - t0, start - t0]
        )
        record = replace(empty, v=100 + signature(t, X, protocol.timing))
        box = search_box(record, protocol)
        if (box.lower <= X).all() and (box.upper >= X).all():
            return X, add_noise(record, noise, generator), protocol


@pytest.mark.parametrize("seed", [1586741660, 2, 3])
def test_a_record_that_is_nearly_noise_has_a_fit_though_its_best_window_may_hold_too_few_samples(
    seed,
):
    (clean,) = simulate_recordings(identified_joint(), [1.2e-4])
    fit = global_fit(add_noise(clean, 1.0, np.random.default_rng(seed)))
    low, high = fit.amplitude_interval_rps
    assert np.isfinite(fit.X).all()
    assert 0 <= low < high or low < 0 < high


def test_the_amplitude_is_that_of_a_window_that_starts_midway_between_samples():
    fit = global_fit(signature_record(noise_rps=0.0))  # the true window starts at 0.025 s: midway
    assert fit.amplitude_rps == pytest.approx(0.6, rel=1e-6)
    later = TRUE_X + np.array([0, 0, 0, 0, 0, 0, 0.0007])
    assert global_fit(signature_record(later, noise_rps=0.0)).amplitude_rps == pytest.approx(
        0.6, rel=0.02
    )


@pytest.mark.parametrize("level", [4, 7, 12])
def test_no_cma_es_run_beats_it_on_the_authors_records(authors_data, level):
    for record in (load_clean(level), load_noisy(level, 1)):
        best = min(table2.fit(record, PROTOCOL, seed).rmse for seed in range(1, 5))
        assert global_fit(record).rmse <= best + 1e-9


@pytest.mark.parametrize("first", [0, 3, 37, 90, 111, 190])
def test_a_record_may_be_cut_anywhere(first):
    fit = global_fit(from_sample(signature_record(noise_rps=0.03), first))
    assert fit.amplitude_rps == pytest.approx(0.6, rel=0.05)


def test_windows_that_overlap_are_fitted_as_they_add_up():
    X = np.array([0.6, 0.0005, 5.5, 134.0, 100.0, 0.2037, 0.0003])
    record = signature_record(X, noise_rps=0.001)
    at_truth = rmse(record.t, record.v, X, PROTOCOL.timing)
    assert global_fit(record).rmse <= at_truth


def test_the_interval_covers_the_truth_about_95_times_in_100():
    covered = {global_fit: 0, amplitude_of_mean_turn: 0}
    for seed, fit in product(range(100), covered):
        low, high = fit(signature_record(noise_rps=0.1, seed=seed)).amplitude_interval_rps
        covered[fit] += low <= 0.6 <= high
    # The binomial 1 in 1000 limits at 95 %.
    assert all(88 <= count <= 100 for count in covered.values())


def test_what_cannot_be_fitted_is_refused():
    record = signature_record()
    few = replace(record, t=np.linspace(0.0, 0.4, 7), v=record.v[:7])
    with pytest.raises(ValueError, match="7 samples leave nothing over"):
        global_fit(few)
    with pytest.raises(ValueError, match="constant"):
        global_fit(replace(record, v=np.full(record.t.size, 100.0)))
    with pytest.raises(ValueError, match="do not fold"):
        global_fit(record, replace(PROTOCOL, T_d=0.15))


@pytest.mark.parametrize(
    ("dt", "turn_s", "turns", "seeds"),
    [
        *((0.002, 0.4, 12, range(first, first + 20)) for first in (0, 20, 40, 60)),
        (1 / 512, 0.4, 12, range(8)),
        (0.004, 0.4, 12, range(8)),
        (0.002, 0.3337, 12, range(8)),
        (0.002, 0.4, 3, range(8)),
        (0.002, 0.8, 12, range(8)),
        (0.002, 1.3, 12, range(4)),  # not taken half a turn late
    ],
)
def test_a_noise_free_signature_is_recovered_to_rounding_wherever_its_windows_lie(
    dt, turn_s, turns, seeds
):
    missed = {}
    for seed in seeds:
        _, record, protocol = drawn(seed, dt=dt, turn_s=turn_s, turns=turns)
        fit, box = global_fit(record, protocol), search_box(record, protocol)
        if not (fit.rmse < 1e-7 and (box.lower <= fit.X).all() and (box.upper >= fit.X).all()):
            missed[seed] = fit.rmse
    assert missed == {}


@pytest.mark.parametrize("dt", [0.001, 0.002, 0.0037])
def test_a_noisy_record_is_fitted_as_well_as_by_what_it_was_made_from(dt):
    for seed in range(10):
        X, record, protocol = drawn(seed, dt=dt, noise=0.1)
        at_truth = rmse(record.t, record.v, X, protocol.timing)
        fit = global_fit(record, protocol)
        assert fit.rmse == rmse(record.t, record.v, fit.X, protocol.timing) <= at_truth, seed


@pytest.mark.slow
def test_the_fit_has_the_same_bits_with_every_kernel_of_openblas():
    code = "from tests.fitting.test_global_fit import digest; print(digest())"
    for kernel in kernels_here():
        assert printed(code, OPENBLAS_CORETYPE=kernel) == digest()


def digest() -> str:
    found = []
    for seed, noise in product((1, 2), (0.0, 0.1)):
        _, record, protocol = drawn(seed, noise=noise)
        fit = global_fit(record, protocol)
        found += [*fit.X, fit.rmse, *fit.amplitude_interval_rps]
    return np.array(found).tobytes().hex()


def test_factors_give_the_matrix_back_and_drop_what_is_not_independent():
    root = np.random.default_rng(1).normal(size=(4, 4))
    matrix = root @ root.T
    factors = matrix.copy()
    factorise(factors)
    lower = np.tril(factors, -1) + np.eye(4)
    np.testing.assert_allclose(lower @ np.diag(np.diag(factors)) @ lower.T, matrix, rtol=1e-12)
    assert factors[-1, -1] == pytest.approx(1 / np.linalg.inv(matrix)[-1, -1])
    singular = np.ones((2, 2))
    factorise(singular)
    assert singular[1, 1] == 0.0
