"""A record of motor speed, the type that everything passes on; and noise added to it."""

from dataclasses import dataclass, replace

import numpy as np

from replication.arrays import FloatArray

# What the logs are records of: the paper gives the commanded speed, the logs the turn period.
COMMANDED_SPEED_RPS = 100.0
TURN_PERIOD_S = 0.4

RPM_PER_RPS = 60.0


@dataclass(frozen=True)
class Recording:
    """An evenly sampled record of a joint's motor speed during the test movement."""

    t: FloatArray  # time [s], shape (samples,)
    v: FloatArray  # motor speed [rps], shape (samples,)
    commanded_speed_rps: float  # v_t of equation 11
    turn_period_s: float  # of the load
    source: str  # where it comes from; of the authors' data a file's path, and after "!" an archive's member

    @property
    def sample_s(self) -> float:
        """Sampling period [s]."""
        return (self.t[-1] - self.t[0]) / (self.t.size - 1)


def from_sample(recording: Recording, start: int) -> Recording:
    """Drop a record's first `start` samples.

    At least three must be left, and time starts from zero again.
    """
    if not 0 <= start <= recording.t.size - 3:
        raise ValueError(f"start sample {start}: the record has {recording.t.size} samples")
    return replace(recording, t=recording.t[start:] - recording.t[start], v=recording.v[start:])


def uniform_noise(rng: np.random.Generator, half_amplitude_rps: float, size: int) -> FloatArray:
    """Uniform white noise, the law of the authors' noisy logs; shape (size,)."""
    return rng.uniform(-half_amplitude_rps, half_amplitude_rps, size)


def add_uniform_noise(
    recording: Recording, half_amplitude_rps: float, rng: np.random.Generator
) -> Recording:
    """Add uniform white noise n(t) to a record (equation 18), as the authors' noisy logs have it.

    n lies between plus and minus `half_amplitude_rps`, which Table 2 calls the noise amplitude.
    """
    noise = uniform_noise(rng, half_amplitude_rps, recording.v.size)
    return replace(recording, v=recording.v + noise, source=f"{recording.source} + uniform noise")


def add_normal_noise(recording: Recording, sd_rps: float, rng: np.random.Generator) -> Recording:
    """Add normal white noise to a record, as stand-ins for real logs have it."""
    return replace(recording, v=recording.v + rng.normal(0.0, sd_rps, recording.v.size))


def constant_speed(samples: int, dt: float) -> Recording:
    """Make a record without backlash, the commanded speed and nothing else, to add noise to."""
    return Recording(
        dt * np.arange(samples, dtype=float),
        np.full(samples, COMMANDED_SPEED_RPS),
        COMMANDED_SPEED_RPS,
        TURN_PERIOD_S,
        "constant speed",
    )
