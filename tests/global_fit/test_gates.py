import os
import platform
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from replication.compiled.misfit import population_rmse
from replication.datasets import Recording
from replication.global_fit.fit import global_fit
from replication.global_fit.folding import factorise, fold_record
from replication.global_fit.gates import Fit, Record, _best_distance, _last_distance, part_fold
from replication.identify import protocol_box
from replication.methods.readings import protocol_for
from replication.signature import signature
from tests.processors import kernels_here

ALIGNED = ((False, False), (True, False), (False, True), (True, True))


def made(seed, starts_on_sample, ends_on_sample, dt=0.002, turn_s=0.4, turns=12, noise=0.0):
    """A signature that lies in the box which its record gives, and that record."""
    generator = np.random.default_rng([seed, starts_on_sample, ends_on_sample])
    t = dt * np.arange(int(turns * turn_s / dt) + 1)
    protocol = protocol_for(Recording(t, t, 100.0, turn_s, "empty"))
    while True:
        start = generator.uniform(0, 0.9 * turn_s)
        start = t[round(start / dt)] if starts_on_sample else start
        end = start + generator.uniform(0.08, 0.45) * turn_s
        end = t[round(end / dt)] if ends_on_sample else end
        t0 = start - generator.uniform(0, min(start, 0.15 * turn_s))
        A, tau = generator.choice([-1, 1]) * generator.uniform(0.3, 1.5), generator.uniform(5, 30)
        X = np.array([A, t0, tau, generator.uniform(8 * np.pi, 80 * np.pi), 100.0, end - t0, start - t0])
        v = 100 + signature(t, X, protocol.timing)
        record = Recording(t, v, 100.0, turn_s, "made")
        box = protocol_box(record, protocol)
        if (box.lower <= X).all() and (box.upper >= X).all():
            noisy = v + generator.uniform(-noise, noise, v.size) if noise else v
            return X, Recording(t, noisy, 100.0, turn_s, "made"), protocol


@pytest.mark.parametrize("block", range(4))
@pytest.mark.parametrize(("starts", "ends"), ALIGNED)
def test_a_noise_free_signature_is_recovered_to_rounding_wherever_its_windows_start_and_end(starts, ends, block):
    missed = {}
    for seed in range(20 * block, 20 * (block + 1)):
        _, record, protocol = made(seed, starts, ends)
        fit, box = global_fit(record, protocol), protocol_box(record, protocol)
        if not (fit.rmse < 1e-7 and (box.lower <= fit.X).all() and (box.upper >= fit.X).all()):
            missed[seed] = fit.rmse
    assert missed == {}


@pytest.mark.parametrize(("starts", "ends"), ALIGNED)
@pytest.mark.parametrize(
    ("dt", "turn_s", "turns"), [(1 / 512, 0.4, 12), (0.004, 0.4, 12), (0.002, 0.3337, 12), (0.002, 0.4, 3)]
)
def test_it_is_recovered_whatever_the_turn_is_in_samples(dt, turn_s, turns, starts, ends):
    for seed in range(8):
        _, record, protocol = made(seed, starts, ends, dt, turn_s, turns)
        assert global_fit(record, protocol).rmse < 1e-7, seed


@pytest.mark.parametrize("turn_s", [0.8, 1.3])
def test_the_window_of_a_long_turn_is_not_taken_half_a_turn_late(turn_s):
    for seed in range(8):
        _, record, protocol = made(seed, False, False, turn_s=turn_s)
        assert global_fit(record, protocol).rmse < 1e-7, seed


def test_noise_alone_puts_no_gate_on_a_sample_unless_t0_is_at_its_lowest():
    for seed in range(30):
        _, record, protocol = made(seed, False, False, noise=0.15)
        X, upper = global_fit(record, protocol).X, protocol_box(record, protocol).upper
        gates = (X[1] + X[[6, 5]]) / 0.002
        pressed = X[1] < 1e-6 or X[5] > upper[5] - 1e-6
        assert pressed or (np.abs(gates - np.round(gates)) > 1e-6).all(), seed


@pytest.mark.parametrize(("starts", "ends"), ALIGNED)
def test_a_noisy_record_is_fitted_as_well_as_by_what_it_was_made_from_but_for_what_noise_hides(starts, ends):
    hidden = 4 * 24 * (starts + ends) / 2401  # a gate on a sample has to show four times the noise of its 24 samples
    for seed in range(10):
        X, record, protocol = made(seed, starts, ends, noise=0.1)
        at_truth = population_rmse(record.t, record.v, X[None], protocol.timing)[0]
        assert global_fit(record, protocol).rmse <= at_truth * np.sqrt(1 + hidden), seed


def test_the_fit_has_the_same_bits_with_every_kernel_of_openblas():
    if platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("these kernels are x86-64's")
    lines = [
        "from test_gates import ALIGNED, global_fit, made",
        "for starts, ends in ALIGNED:",
        "    for noise in (0.0, 0.1):",
        "        _, record, protocol = made(1, starts, ends, noise=noise)",
        "        fit = global_fit(record, protocol)",
        "        print(fit.X.tobytes().hex(), fit.rmse.hex(), [end.hex() for end in fit.amplitude_interval_rps])",
    ]
    path = os.pathsep.join([os.path.dirname(__file__), *filter(None, sys.path)])
    printed = set()
    for kernel in kernels_here():
        environment = os.environ | {"OPENBLAS_CORETYPE": kernel, "PYTHONPATH": path}
        command = [sys.executable, "-c", "\n".join(lines)]
        printed.add(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
    assert len(printed) == 1
    assert printed.pop().count("\n") == 8


instants = st.floats(0.0, 16.0)


@settings(deadline=None)
@given(start=instants, length=st.floats(1e-6, 0.3))
def test_the_last_distance_just_holds_a_sample_and_the_next_number_does_not(start, length):
    instant = start + length
    opening, closing = _last_distance(start, instant, True), _last_distance(start, instant, False)
    assert start + opening <= instant < start + np.nextafter(opening, np.inf)
    assert start + np.nextafter(closing, -np.inf) < instant <= start + closing


def test_the_best_distance_holds_the_windows_that_gain_most_of_those_that_rounding_can_part():
    starts = 0.4 * np.arange(12) + 0.0125
    samples = 0.002 * np.arange(82, 2400, 200)  # 0.1515 s after each start, but for rounding
    thresholds = np.array([_last_distance(a, b, False) for a, b in zip(starts, samples, strict=True)])
    gains = np.where(thresholds <= np.median(thresholds), 1.0, -1.0)
    T, gain = _best_distance(starts, samples, gains, False)
    np.testing.assert_array_equal(samples <= starts + T, gains > 0)
    assert gain == (gains > 0).sum()


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), overlapping=st.booleans())
def test_a_part_fold_leaves_out_just_the_samples_that_the_windows_do_not_hold(seed, overlapping):
    generator = np.random.default_rng(seed)
    _, record, protocol = made(1, False, False, noise=0.1)
    timing, t, v = protocol.timing, record.t, record.v
    fold = fold_record(t, v, timing)
    a, b = 5, 105 if overlapping else 60
    holds_a, holds_b = generator.random((2, 24)) < 0.5
    fit = Fit(a, b, np.array([0.004, 12.0, 120.0]), 0.0, holds_a, holds_b)
    part = part_fold(Record(t, v, timing, None, fold), fit)
    wave = generator.normal(size=t.size)  # any waveform will do
    unit = np.zeros(t.size)
    for m in range(24):
        inside = [k for k in range(a, b + 1) if (k > a or holds_a[m]) and (k < b or holds_b[m])]
        inside = [k for k in inside if k + 100 * m < t.size]
        unit[np.array(inside, dtype=int) + 100 * m] += (-1) ** m * wave[inside]
    held = np.arange(a, b + 1)
    partner = part.partner[held]
    pairs = np.where((partner >= a) & (partner <= b), part.pairs[held] * wave[held] * wave[partner], 0.0)
    assert unit @ (v - v.mean()) == pytest.approx(wave[held] @ part.value[held], rel=1e-9, abs=1e-9)
    assert unit @ unit == pytest.approx((part.count[held] * wave[held] ** 2).sum() - 2 * pairs.sum(), rel=1e-9)
    assert unit.sum() == pytest.approx(wave[held] @ part.sign[held], rel=1e-9, abs=1e-9)


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
