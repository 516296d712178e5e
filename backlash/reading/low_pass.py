"""A Butterworth filter run to and fro: to rounding SciPy's `butter` and `sosfiltfilt`, which are slow to import."""

import numba
import numpy as np

from replication.arrays import FloatArray

_ORDER, _PADDING = 6, 21


@numba.njit(cache=True)
def _run_section(wave, numerator, denominator, first, second):
    """Filter in place by one section of second order, from the memory that it would have of a constant."""
    for i in range(wave.size):
        x = wave[i]
        wave[i] = numerator[0] * x + first
        first = numerator[1] * x - denominator[1] * wave[i] + second
        second = numerator[2] * x - denominator[2] * wave[i]


def low_pass(v: FloatArray, edge_hz: float, sample_s: float) -> FloatArray:
    """Take off what is faster than an edge, without delay."""
    edge = 4 * np.tan(np.pi * (2 * edge_hz / (1 / sample_s)) / 2)
    analog = -np.exp(1j * np.pi * np.arange(1 - _ORDER, _ORDER, 2) / (2 * _ORDER)) * edge
    poles = (4 + analog) / (4 - analog)
    numerator = edge**_ORDER * np.real(1 / np.prod(4 - analog)) * np.array([1.0, 2.0, 1.0])
    sections, passed = [], 1.0
    for pole in poles[_ORDER // 2 - 1 :: -1]:
        denominator = np.real(np.poly([pole, pole.conj()]))
        change = np.array([[1 + denominator[1], -1.0], [denominator[2], 1.0]])
        memory = passed * np.linalg.solve(change, numerator[1:] - denominator[1:] * numerator[0])
        sections.append((numerator, denominator, memory))
        passed *= numerator.sum() / denominator.sum()
        numerator = np.array([1.0, 2.0, 1.0])
    before, after = 2 * v[0] - v[_PADDING:0:-1], 2 * v[-1] - v[-2 : -_PADDING - 2 : -1]
    wave = np.concatenate([before, v, after])
    for _ in range(2):
        begin = wave[0]
        for numerator, denominator, memory in sections:
            _run_section(wave, numerator, denominator, *(memory * begin))
        wave = wave[::-1].copy()
    return wave[_PADDING:-_PADDING]
