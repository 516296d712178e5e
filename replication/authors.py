"""The authors' records: their files found locally or downloaded, verified, and read."""

import hashlib
import io
import os
import re
import zipfile
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd

from replication import published
from replication.arrays import FloatArray
from replication.files import UserError
from replication.recording import COMMANDED_SPEED_RPS, TURN_PERIOD_S, Recording, add_uniform_noise
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings

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


class DataUnavailable(UserError):
    """The authors' data are neither in `BACKLASH_DATA` nor to be downloaded."""


class DataCorrupt(UserError):
    """A file of the authors' data is not what it should be."""


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


def public_file(address: str, name: str, digest: str, variable: str, cache: Path) -> Path:
    """Find a public file by its name in the folder that an environment variable names, or else download it."""
    if local := os.environ.get(variable):
        return _verified_local(Path(local) / name, digest, variable)
    import pooch  # slow to import, and not used by the sensor

    downloader = pooch.HTTPDownloader(timeout=20)
    try:
        return Path(pooch.retrieve(address, digest, name, cache, downloader=downloader))
    except ValueError as error:
        raise DataCorrupt(
            f"{name}: the download lacks the registered SHA-256; try again later"
        ) from error
    except OSError as error:
        advice = f"connect to the network, or set {variable} to a copy of the repository"
        if isinstance(error, PermissionError):
            advice = (
                f"set {variable}, or XDG_CACHE_HOME to a folder that can be written, not {cache}"
            )
        raise DataUnavailable(
            f"{name}: cannot be downloaded ({type(error).__name__}); {advice}"
        ) from error


def _verified_local(file: Path, digest: str, variable: str) -> Path:
    """Check a local file against its registered SHA-256."""
    try:
        if file.is_fifo():  # to read it would wait for ever
            raise OSError(0, "a pipe")
        content = file.read_bytes()
    except OSError as error:
        raise DataUnavailable(
            f"{file}: not readable ({error.strerror}); is {variable} right?"
        ) from error
    if hashlib.sha256(content).hexdigest() != digest:
        raise DataCorrupt(f"{file}: its SHA-256 is not the registered one; copy it again")
    return file


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


def records_are_simulated() -> bool:
    """Whether our records take the authors' place; whoever runs notebooks says so where these cannot be had."""
    return os.environ.get("BACKLASH_RECORDS") == "simulated"


def load_clean(level: int) -> Recording:
    """Load the authors' noise-free record of level K, `SpeeddataK.xlsx`; K = 3 to 13 are public."""
    if records_are_simulated():
        return simulate_recordings(identified_joint(), [level_delta_rad(level)])[0]
    path = f"Speeddata{level}.xlsx"
    return _authors_recording(authors_file(path).read_bytes(), path)


def load_clean_records(levels: Iterable[int]) -> dict[float, Recording]:
    """Load the authors' clean records of some levels K, by backlash [rad]."""
    return {level_delta_rad(level): load_clean(level) for level in levels}


def load_noisy(level: int, realisation: int) -> Recording:
    """Load the authors' noisy record of a level K, 1 to 20, and a realisation R of the low noise, 1 to 5."""
    if level not in NOISY_LEVELS or realisation not in LOW_NOISE:
        raise ValueError(
            f"no noisy record K = {level}, R = {realisation}: K is 1 to 20, R is 1 to 5"
        )
    if records_are_simulated():
        half = 0.1 + (level - 1) * 0.15 / 19  # the law of their noise, which Table 2's rows obey
        rng = np.random.default_rng((realisation, level))
        return add_uniform_noise(load_clean(level), half, rng)
    path = f"Noisy data/Low level of noise/Data_with_Noise_{realisation}.zip"
    content = read_zip_member(authors_file(path), rf"(.*/)?SpeeddataNoise{level}(_\d+)?\.xlsx")
    return _authors_recording(content, f"{path}!SpeeddataNoise{level}")


def _authors_recording(content: bytes, source: str) -> Recording:
    t, v = parse_speed_workbook(content)
    return Recording(t, v, COMMANDED_SPEED_RPS, TURN_PERIOD_S, source)
