"""Does a second mass swing on the load? A joint with one rings twice, and its backlash is misread by one without.

To first order in its share of the load's inertia, a second mass on a spring pushes the load with
what it lacks of the load's acceleration. That is known from the turn without it, so one linear step
tells share, backlash and evidence.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from backlash.fitting.joint_posterior import Problem
from backlash.fitting.joint_search import Peak
from backlash.fitting.turns import Movement
from replication.arrays import FloatArray

# Where a second mass may ring [Hz], and how it is damped: below, it swings with the load, and above
# it sits on it.
_RINGS_HZ, _DAMPING = np.geomspace(8.0, 80.0, 31), 0.03
# Probability that a joint has one at all: nobody knows. SD of its share of the inertia; of either
# sign, for it stands for whatever else the load does that the joint of notebook 9 does not.
_PROBABILITY, _SHARE = 0.5, 0.1


class WeightedPeak(NamedTuple):
    """A peak of the posterior, and the logarithm of its prior probability."""

    log_prior: float
    peak: Peak

    @property
    def log_weight(self) -> float:
        """Of it among all peaks."""
        return self.log_prior + self.peak.evidence


class SecondMass(NamedTuple):
    """The clearest second mass: probability that noise alone shows one so clearly, and where it rings."""

    chance: float = 1.0
    ring_hz: float = np.nan


def pushes(load_speed: FloatArray, gravity_per_s2: float, movement: Movement) -> FloatArray:
    """What second masses do to the load, per share of its inertia [rad/s^2], shape (rings, phases).

    A mass swings by z'' + 2 zeta w z' + w^2 z = -(x'' + g sin), z being its angle from the load's
    and x the load's, whose speed [rad/s] is given over a turn; it pushes the load with -z''.
    """
    phases = load_speed.size
    w = 2 * np.pi * np.arange(phases // 2 + 1) / movement.turn_period_s
    ring = 2 * np.pi * _RINGS_HZ[:, None]
    gravity = gravity_per_s2 * np.sin(2 * np.pi * np.arange(phases) / phases)
    moved = 1j * w * np.fft.rfft(load_speed) + np.fft.rfft(gravity)
    return np.fft.irfft(-(w**2) * moved / (ring**2 - w**2 + 2j * _DAMPING * ring * w), phases)


def with_second_mass(problem: Problem, peak: Peak) -> tuple[list[WeightedPeak], SecondMass]:
    """Peaks without a second mass, then with one of each ring; and the clearest of these."""
    residual, slopes = problem.slopes(peak.z)
    columns = problem.push_slopes(peak.z, pushes)
    along = np.linalg.solve(slopes @ slopes.T, slopes @ columns.T).T
    left = columns - along @ slopes
    information = (left**2).sum(axis=1) + _SHARE**-2
    share = -left @ residual / information
    sd = information**-0.5
    gain = share**2 * information
    evidence = np.log(sd / _SHARE) + gain / 2
    found = [WeightedPeak(np.log(1 - _PROBABILITY), peak)]
    for k in range(_RINGS_HZ.size):
        there = replace(
            peak,
            z=peak.z - share[k] * along[k],
            covariance=peak.covariance + np.outer(along[k], along[k]) * sd[k] ** 2,
            residual=residual + share[k] * left[k],
            evidence=peak.evidence + float(evidence[k]),
        )
        found.append(WeightedPeak(np.log(_PROBABILITY / _RINGS_HZ.size), there))
    chance = float(min(1.0, _RINGS_HZ.size * chdtrc(1, gain.max())))
    return found, SecondMass(chance, float(_RINGS_HZ[gain.argmax()]))
