"""Records of motor speed: the authors' published logs, and noise added to a record."""

from dataclasses import dataclass, replace

import numpy as np

from replication.arrays import FloatArray
from replication.data.authors import authors_file, parse_speed_workbook, read_zip_member

# The noisy records that are public: levels K, and realisations R at two levels of noise.
NOISY_LEVELS, LOW_NOISE, HIGH_NOISE = range(1, 21), range(1, 6), range(11, 21)
# What the logs are records of: the paper gives the commanded speed, the logs the turn period.
COMMANDED_SPEED_RPS = 100.0
TURN_PERIOD_S = 0.4


@dataclass(frozen=True)
class Recording:
    """An evenly sampled record of a joint's motor speed during the test movement."""

    t: FloatArray  # time [s], shape (samples,)
    v: FloatArray  # motor speed [rps], shape (samples,)
    commanded_speed_rps: float  # v_t of equation 11
    turn_period_s: float  # of the load
    source: str  # where it comes from; of the authors' data the file's path, and after "!" the member of an archive

    @property
    def sample_s(self) -> float:
        """Sampling period [s]."""
        return (self.t[-1] - self.t[0]) / (self.t.size - 1)


def from_sample(recording: Recording, start: int) -> Recording:
    """Drop a record's first `start` samples; at least three must be left, and time starts from zero again."""
    if not 0 <= start <= recording.t.size - 3:
        raise ValueError(f"start sample {start}: the record has {recording.t.size} samples")
    if start == 0:
        return recording
    return replace(recording, t=recording.t[start:] - recording.t[start], v=recording.v[start:])


def add_uniform_noise(recording: Recording, half_amplitude_rps: float, rng: np.random.Generator) -> Recording:
    """Add uniform white noise n(t) to a record (equation 18), as the authors' noisy logs have it.

    n lies between plus and minus `half_amplitude_rps`, which Table 2 calls the noise amplitude.
    """
    noise = rng.uniform(-half_amplitude_rps, half_amplitude_rps, recording.v.size)
    return replace(recording, v=recording.v + noise, source=f"{recording.source} + uniform noise")


def constant_speed(samples: int, dt: float) -> Recording:
    """Make a record without backlash, the commanded speed and nothing else, to add noise to."""
    v = np.full(samples, COMMANDED_SPEED_RPS)
    return Recording(dt * np.arange(samples, dtype=float), v, COMMANDED_SPEED_RPS, TURN_PERIOD_S, "constant speed")


def level_delta_rad(level: int) -> float:
    """Backlash of the authors' dataset K, (2K - 1)e-4 rad: Table 2's ten rows are K = 2 to 11."""
    return (2 * level - 1) * 1e-4


def load_clean(level: int) -> Recording:
    """Load the authors' noise-free record of level K (`SpeeddataK.xlsx`; K = 3 to 13 are public)."""
    path = f"Speeddata{level}.xlsx"
    return _authors_recording(authors_file(path).read_bytes(), path)


def load_noisy(level: int, realisation: int) -> Recording:
    """Load the authors' noisy record of level K, 1 to 20, and realisation R, 1 to 5 (low noise) or 11 to 20 (high)."""
    if level not in NOISY_LEVELS or realisation not in (*LOW_NOISE, *HIGH_NOISE):
        raise ValueError(f"no noisy record K = {level}, R = {realisation}: K is 1 to 20, R is 1 to 5 or 11 to 20")
    loudness = "Low" if realisation in LOW_NOISE else "High"
    path = f"Noisy data/{loudness} level of noise/Data_with_Noise_{realisation}.zip"
    content = read_zip_member(authors_file(path), rf"(.*/)?SpeeddataNoise{level}(_\d+)?\.xlsx")
    return _authors_recording(content, f"{path}!SpeeddataNoise{level}")


def _authors_recording(content: bytes, source: str) -> Recording:
    t, v = parse_speed_workbook(content)
    return Recording(t, v, COMMANDED_SPEED_RPS, TURN_PERIOD_S, source)
