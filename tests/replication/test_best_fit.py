"""The least misfit is found, and no run of the search ends below it."""

import numpy as np
import pytest

from replication import best_fit, table2
from replication.records import constant_speed
from replication.signature import Box, rmse
from studies import standins
from tests.made import TRUE, make_record


@pytest.mark.parametrize("settings", [table2.NOTEBOOK, table2.RPM_600])
def test_a_fit_finds_the_signature_in_noise_and_the_best_fit_none_that_is_worse(settings):
    record = make_record()
    best = best_fit.best_fit(record)
    runs = [table2.fit(record, settings, seed) for seed in (1, 2, 3)]
    run = min(runs, key=lambda fit: fit.rmse)
    assert best.rmse <= run.rmse * (1 + 1e-9)
    for fit in (best, run):
        assert fit.rmse <= rmse(record.t, record.v, TRUE)
        assert fit.rmse == pytest.approx(rmse(record.t, record.v, fit.X), rel=1e-9)
        assert fit.amplitude_rps == pytest.approx(0.6, rel=0.03)  # A is free within a sample
        assert fit.X.omega == pytest.approx(134, rel=0.01)
        assert fit.X.v_t == pytest.approx(100, abs=0.01)
    assert best.amplitude_rps == pytest.approx(0.6, rel=0.01)
    opening = (best.X.t0 + best.X.T1) / record.sample_s  # midway between two samples
    assert opening % 1 == pytest.approx(0.5) or best.X.T1 == 0


# Ten runs of CMA-ES end 3, 7 and 0 % above.
@pytest.mark.parametrize(
    ("seed", "least_rps"), [(0, 0.07482617), (4, 0.07783660), (11, 0.09993275)]
)
def test_the_best_fit_of_a_bench_log_is_not_the_same_oscillation_half_a_period_off(seed, least_rps):
    rng = np.random.default_rng(seed)
    record = standins.encoder_log(standins.draw_bench(rng), 1e-3, rng)
    assert best_fit.best_fit(record).rmse == pytest.approx(least_rps, rel=1e-4)


def test_the_best_fit_is_sought_in_nine_half_periods_either_way_and_in_windows_twelve_samples_off():
    shape, dt, tried = np.array([0.5, 15.0, 130.0, 0.152, 0.012]), 2e-3, []
    box = Box(np.zeros(5), np.array([1.0, 30.0, 250.0, 0.2, 0.1]))

    def misfits_from(target):
        tried.clear()
        return lambda shapes: tried.append(shapes) or ((shapes - target) ** 2).sum(axis=1)

    for half_periods in (-9, 9):
        target = shape + np.array([half_periods * np.pi / 130, 0, 0, -0.004, 0.01])
        basins = best_fit._best_basins(misfits_from(target), shape, box, dt)
        assert len(basins) == 3
        np.testing.assert_allclose(basins[0], target, rtol=1e-5)
        assert [len(shapes) for shapes in tried[:20]] == [50 * 50] * 19 + [1]
        np.testing.assert_allclose(np.ptp(tried[0], axis=0), [0, 0, 0, 0.196, 0.098])
    target = shape + dt * np.array([0, 0, 0, 12, -6])
    window = best_fit._best_window(misfits_from(target), shape, dt)
    np.testing.assert_allclose(window, target, rtol=1e-5)
    np.testing.assert_allclose(np.ptp(tried[0], axis=0), dt * np.array([0, 0, 0, 24, 12]))
    steps = np.concatenate(tried[1:7]) - target
    np.testing.assert_allclose(steps, [np.zeros(5), *np.diag([dt, 1, 1, dt, dt])], atol=1e-12)


def test_the_best_fit_keeps_the_bound_of_A():
    record = make_record(TRUE._replace(tau=30.0, omega=40.0))
    best, run = best_fit.best_fit(record), table2.fit(record, table2.NOTEBOOK, 2)
    assert best.rmse <= run.rmse * (1 + 1e-9)
    assert best.amplitude_rps < 1.05 * table2.search_box(record, table2.NOTEBOOK).upper[0]


def test_a_constant_record_has_no_best_fit():
    with pytest.raises(ValueError, match="constant speed: constant"):
        best_fit.best_fit(constant_speed())
