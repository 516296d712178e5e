"""Records of motor speed: their type, noise added to them, and the authors' files, found locally or downloaded."""

import io
import os
import re
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd

from replication import published
from replication.arrays import FloatArray
from replication.public_files import DataUnavailable, public_file

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


# ------------------------------------------------------------------------------------ the authors' files


AUTHORS_COMMIT = "7c81edefe3e61479d234d5080d4627dbbf584733"
AUTHORS_URL = (
    f"https://raw.githubusercontent.com/ElianaGiovannitti/Backlash-estimation/{AUTHORS_COMMIT}/"
)

# Levels K of their data: those published clean and noisy, and all from Table 2's first row on.
CLEAN_LEVELS = range(3, 14)
NOISY_LEVELS = range(1, 21)
ALL_LEVELS = range(2, 21)
LOW_NOISE = range(1, 6)  # realisations R of the noise whose amplitudes Table 2 prints

WORKBOOK_FILES = (
    *(f"Speeddata{level}.xlsx" for level in CLEAN_LEVELS),
    *(
        f"Noisy data/Low level of noise/Data_with_Noise_{realisation}.zip"
        for realisation in LOW_NOISE
    ),
)


def authors_registry() -> dict[str, str]:
    """SHA-256 of each file of the authors' repository at `AUTHORS_COMMIT`, by its path there."""
    text = (published.DATA / "authors_sha256.txt").read_text(encoding="utf-8")
    return {path: digest for digest, path in (line.split("  ", 1) for line in text.splitlines())}


def data_folder() -> Path:
    """Folder that the authors' data are read from: `BACKLASH_DATA`, or else the download cache."""
    if local := os.environ.get("BACKLASH_DATA"):
        return Path(local)
    import pooch  # slow to import, and not used by the sensor

    return Path(pooch.os_cache("backlash-replication"))


def authors_file(path: str, base_url: str = AUTHORS_URL, cache: Path | None = None) -> Path:
    """Find one file of the authors' data and verify it.

    Looked for in the folder that the environment variable `BACKLASH_DATA` names; without that
    variable, in the download cache, and downloaded where it is not there yet.
    """
    registry = authors_registry()
    if path not in registry:
        raise DataUnavailable(
            f"{path}: no such file in the authors' repository at {AUTHORS_COMMIT[:7]}"
        )
    folder = cache or data_folder()
    return public_file(base_url + quote(path), path, registry[path], "BACKLASH_DATA", folder)


def parse_speed_workbook(content: bytes) -> tuple[FloatArray, FloatArray]:
    """Read time and speed from the bytes of an XLSX file of the authors, which `authors_file` has verified.

    Blank rows are dropped, and so is a first row whose time stamp the second row repeats (it is no
    sample).
    """
    table = pd.read_excel(io.BytesIO(content), header=None).dropna(how="all").to_numpy(dtype=float)
    repeated = table[1, 0] == table[0, 0]
    t, v = table[int(repeated) :].T.copy()
    return t, v


def read_zip_member(archive: Path, pattern: str) -> bytes:
    """Read the one member of a zip archive whose whole name matches a regular expression."""
    with zipfile.ZipFile(archive) as bundle:
        (member,) = (name for name in bundle.namelist() if re.fullmatch(pattern, name))
        return bundle.read(member)


def level_delta_rad(level: int) -> float:
    """Backlash of the authors' dataset K, (2K - 1)e-4 rad: Table 2's ten rows are K = 2 to 11."""
    return (2 * level - 1) * 1e-4


def read_clean(level: int) -> Recording:
    """Read the authors' noise-free record of level K, `SpeeddataK.xlsx`; K = 3 to 13 are public."""
    path = f"Speeddata{level}.xlsx"
    return _authors_recording(authors_file(path).read_bytes(), path)


def read_noisy(level: int, realisation: int) -> Recording:
    """Read the authors' noisy record of a level K and a realisation R of the low noise."""
    check_noisy(level, realisation)
    path = f"Noisy data/Low level of noise/Data_with_Noise_{realisation}.zip"
    content = read_zip_member(authors_file(path), rf"(.*/)?SpeeddataNoise{level}(_\d+)?\.xlsx")
    return _authors_recording(content, f"{path}!SpeeddataNoise{level}")


def check_noisy(level: int, realisation: int) -> None:
    """Refuse a level K or a realisation R that the authors' low noise does not have."""
    if level not in NOISY_LEVELS or realisation not in LOW_NOISE:
        raise ValueError(
            f"no noisy record K = {level}, R = {realisation}: K is 1 to 20, R is 1 to 5"
        )


def _authors_recording(content: bytes, source: str) -> Recording:
    t, v = parse_speed_workbook(content)
    return Recording(t, v, COMMANDED_SPEED_RPS, TURN_PERIOD_S, source)
