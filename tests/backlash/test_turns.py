"""The mean turn of signals whose harmonics, noise and period are known."""

from dataclasses import replace

import numpy as np
import pytest

from backlash import turns
from backlash.turns import TURN
from replication.records import Recording


def record(size=1200, period_s=0.4013):
    t = 4e-3 * np.arange(size)
    return Recording(t, np.ones(size), 100.0, period_s, "made")


@pytest.mark.parametrize(
    ("whole", "number"), [(1.51, 1), (2.51, 2), (3.49, 2), (3.51, 3), (12.0, 11)]
)
def test_settled_turns_leave_half_a_turn_or_more_at_the_start(whole, number):
    made = record(1200, 4.8 / whole)
    rows = turns.settled_turns(made, made.t)
    assert rows.shape == (number, int(np.ceil(1200 / whole - 1e-3)))
    # A straight line shows the instants: whole turns up to one sample after the last.
    expected = 4.8 + made.turn_period_s * (np.arange(rows.size) / rows.shape[1] - number)
    np.testing.assert_allclose(rows.ravel(), np.minimum(expected, made.t[-1]), atol=1e-9)


def test_a_settled_turn_of_sixteen_samples_is_needed():
    made = record(400, 4e-3 * 16.01)
    assert turns.settled_turns(made, made.t).shape == (24, 17)
    for made in (record(400, 4e-3 * 15.99), record(1200, 4.8 / 1.49)):
        with pytest.raises(ValueError, match="one turn of 16"):
            turns.settled_turns(made, made.t)


def test_harmonics_are_exact_beside_a_drift():
    made = record()
    # The angle is 0 where the turns begin: a whole number of turns before the sample after the last.
    angle = TURN * (made.t - 4e-3 * 1200) / made.turn_period_s
    signal = 3.0 + 0.7 * np.cos(angle + 0.4) + 0.02 * np.cos(9 * angle - 1)
    result = turns.harmonics(made, signal + 0.05 * made.t, 30.0)
    np.testing.assert_array_equal(result.order, np.arange(1, 13))  # 30 Hz times 0.4013 s
    np.testing.assert_allclose(result.omega, TURN / 0.4013 * result.order)
    expected = np.zeros(12, dtype=complex)
    expected[[0, 8]] = 0.35 * np.exp(0.4j), 0.01 * np.exp(-1j)
    np.testing.assert_allclose(result.coefficient, expected, atol=2e-4)
    fast = turns.harmonics(made, signal, 1e3).order
    assert fast[-1] == int(0.45 * 250 * 0.4013)


def test_a_harmonic_s_noise_is_that_of_three_harmonics_to_either_side():
    made = record(12 * 100, 0.4)
    signal = np.random.default_rng(1).normal(size=1200)
    result = turns.harmonics(made, signal, 100.0)
    rows = signal[100:].reshape(11, 100)
    y = rows.ravel() - np.arange(1100) * (rows[-1].mean() - rows[0].mean()) / 1000
    power = np.abs(np.fft.fft(y - y.mean()) / 1100) ** 2 / 2
    for k in (4, 10):  # lines between harmonics, from k - 3 to k + 3
        beside = [line for line in range(11 * (k - 3), 11 * (k + 3)) if line % 11]
        assert result.sd[k - 1] == pytest.approx(np.sqrt(power[beside].mean()), rel=1e-9)


def test_phases_and_waves_begin_where_the_settled_turns_do():
    made = record()
    phase = turns.turn_phases(made, 1150)
    assert phase[1150] == 0
    assert phase[-1] == pytest.approx(49 * 4e-3 / 0.4013 % 1)
    np.testing.assert_allclose(np.diff(phase) % 1, 4e-3 / 0.4013, rtol=1e-9)
    wave = turns.periodic(np.array([0.5j, 0.1]), np.array([1, 7]), phase)
    expected = -np.sin(TURN * phase) + 0.2 * np.cos(7 * TURN * phase)
    np.testing.assert_allclose(wave, expected, atol=5e-3)


def test_a_record_ends_where_gravity_last_passes_a_sixteenth_of_a_turn():
    made = record(1200, 0.4013)
    torque = 3 * np.cos(TURN * (made.t / 0.4013 + 0.03))
    whole, own = turns.end_by_gravity(made, torque)
    turned = whole.t[-1] / 0.4013 + 0.03
    assert abs(16 * turned - round(16 * turned)) < 16 * 2.1e-3 / 0.4013
    assert whole.t[-1] > made.t[-1] - 0.4013 / 16 - 2.1e-3
    assert (whole.v.size, own.size) == (whole.t.size, whole.t.size)
    # By rounding periods drift over the record by a fifth of a millisecond at most.
    for exact, rounded in ((0.4013, whole.turn_period_s), (4e-3, whole.sample_s)):
        assert rounded == pytest.approx(exact, rel=2e-4 / made.t[-1])
        assert rounded * 2**30 % 1 == 0


def test_gravity_s_line_is_that_of_each_whole_turn():
    made = record(1050, 0.4)  # ten turns and a half
    made = replace(made, t=made.t + 2e-3)  # no sample where a turn begins
    torque = 2 + 3 * np.cos(TURN * made.t / 0.4 + 0.3) * (1 + 0.1 * (made.t > 2))
    lines = turns.gravity_by_turn(made, torque - 0.01 * (made.t > 4))
    expected = 1.5 * np.exp(0.3j) * np.where(np.arange(10) < 5, 1, 1.1)
    np.testing.assert_allclose(lines, expected, rtol=1e-9)
    assert turns.gravity_by_turn(record(1001, 0.4), np.ones(1001)).size == 10


@pytest.mark.parametrize("ratio", [0.99, 1.004])
def test_the_period_is_that_of_gravity_s_line_if_there_is_one(ratio):
    made = record(1200, 0.4)
    torque = np.cos(TURN * made.t / (ratio * 0.4) + 0.5)
    assert turns.period_by_torque(made, torque) == pytest.approx(ratio * 0.4, rel=3e-4)
    # In noise the mean of twelve lines must be ten of its SDs.
    noise = np.random.default_rng(2).normal(size=1200)
    for share, is_detected in ((0.25, True), (0.15, False)):
        result = turns.period_by_torque(made, share * torque + 0.45 * noise)
        assert (result != 0.4) == is_detected


@pytest.mark.parametrize(
    ("orders", "result"),
    [
        ({1.0: 1.0}, None),  # the turn's own
        ({2.0: 1.0}, 2.0),
        ({0.5: 1.0}, 0.5),
        ({2.004: 1.0}, 2.004),  # between two steps of the spectrum
        ({7.8: 1.0}, 7.8),
        ({8.2: 1.0}, None),  # beyond three octaves
        ({0.11: 1.0}, None),
        ({0.22: 1.0}, 0.22),  # more than two turns in the record
        ({2.0: 1.0, 1.0: 0.32}, 2.0),  # a third of it
        ({2.0: 1.0, 1.0: 0.35}, None),
        ({2.0: 1.0, 5.5: 0.95}, 2.0),  # half of the variance
        ({2.0: 1.0, 5.5: 0.95, 3.3: 0.4}, None),
    ],
)
def test_a_line_is_another_turn_s_if_it_is_more_than_the_torque_s_others(orders, result):
    made = record(1200, 0.4)
    angle = TURN * made.t / 0.4
    torque = sum(size * np.cos(order * angle) for order, size in orders.items())
    period = turns.dominant_period(made, 5 + torque)
    assert period == (None if result is None else pytest.approx(0.4 / result, rel=1.5e-3))


@pytest.mark.parametrize("order", [2.03, 0.1245])
def test_a_line_s_period_is_read_between_the_steps_of_its_spectrum_and_beyond_them(order):
    made = record(12000, 0.4)
    torque = 5 + np.cos(TURN * order * made.t / 0.4)
    assert turns.dominant_period(made, torque) == pytest.approx(0.4 / order, rel=2e-4)


def test_the_period_with_the_most_energy_is_taken_if_it_has_5_per_cent_more():
    made = record(1200, 0.4)

    def pulses(period_s, share=1.0):
        phase = made.t / period_s % 1
        return share * np.sin(20 * TURN * phase) * np.exp(-20 * phase)

    grid = 0.005 * 0.4 / 40
    for period in (0.3985, 0.4012):
        result = turns.period_by_energy(made, 7 + pulses(period))
        assert result == pytest.approx(period, abs=0.6 * grid)
    long = record(12000, 0.4)
    result = turns.period_by_energy(
        long, np.sin(TURN * long.t / 0.3987)
    )  # the first harmonic alone
    assert result == pytest.approx(0.3987, abs=0.6 * grid)
    assert turns.period_by_energy(made, pulses(0.4002)) == 0.4  # a drift that costs less


@pytest.mark.parametrize("sign", [1, -1])
def test_periods_are_the_same_by_drift_and_near_by_a_clock(sign):
    made = record(1001, 0.4)  # 4 s
    same = [turns.is_same_period(made, 0.4 + sign * drift_s / 10) for drift_s in (2.4e-3, 2.6e-3)]
    near = [turns.is_near_period(made, 0.4 * (1 + sign * share)) for share in (0.0049, 0.0051)]
    assert same == near == [True, False]
