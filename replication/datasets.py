"""Records of motor speed: the authors' published logs, found locally or downloaded and verified."""

import hashlib
import io
import os
import re
import zipfile
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd
import pooch
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

AUTHORS_COMMIT = "7c81edefe3e61479d234d5080d4627dbbf584733"
AUTHORS_URL = f"https://raw.githubusercontent.com/ElianaGiovannitti/Backlash-estimation/{AUTHORS_COMMIT}/"

# What the logs are records of: the paper gives the commanded speed, the logs the turn period.
COMMANDED_SPEED_RPS = 100.0
TURN_PERIOD_S = 0.4

WORKBOOK_FILES = (
    *(f"Speeddata{level}.xlsx" for level in range(3, 14)),
    *(f"Noisy data/Low level of noise/Data_with_Noise_{realisation}.zip" for realisation in (1, 2)),
)


class DataUnavailable(RuntimeError):
    """The authors' data are neither in `BACKLASH_DATA` nor to be downloaded."""


class DataCorrupt(RuntimeError):
    """A file of the authors' data is not what it should be."""


@dataclass(frozen=True)
class Recording:
    """An evenly sampled record of a joint's motor speed during the test movement.

    Attributes
    ----------
    t : array of shape (samples,)
        Time [s].
    v : array of shape (samples,)
        Motor speed [rps].
    commanded_speed_rps : float
        Commanded motor speed v_t of equation 11 [rps].
    turn_period_s : float
        Period of a load turn [s].
    source : str
        Where it comes from; for the authors' data the file's path, and after "!" the member of a zip archive.
    """

    t: FloatArray
    v: FloatArray
    commanded_speed_rps: float
    turn_period_s: float
    source: str

    @property
    def sample_s(self) -> float:
        """Sampling period [s]."""
        return (self.t[-1] - self.t[0]) / (self.t.size - 1)


def from_sample(recording: Recording, start: int) -> Recording:
    """Drop a record's first `start` samples; time starts from zero again.

    Raises
    ------
    ValueError
        Fewer than three samples would be left.
    """
    if not 0 <= start <= recording.t.size - 3:
        raise ValueError(f"start sample {start}: the record has {recording.t.size} samples")
    if start == 0:
        return recording
    t = recording.t[start:] - recording.t[start]
    return replace(recording, t=t, v=recording.v[start:])


def add_uniform_noise(recording: Recording, half_amplitude_rps: float, rng: np.random.Generator) -> Recording:
    """Add uniform white noise n(t) to a record (equation 18), as the authors' noisy logs have it.

    Parameters
    ----------
    recording : Recording
        The clean record.
    half_amplitude_rps : float
        Table 2's noise amplitude [rps]: n lies between plus and minus this.
    rng : Generator
        Where the noise comes from.

    Returns
    -------
    Recording
    """
    noise = rng.uniform(-half_amplitude_rps, half_amplitude_rps, recording.v.size)
    return replace(recording, v=recording.v + noise, source=f"{recording.source} + uniform noise")


def constant_speed(samples: int, dt: float) -> Recording:
    """Make a record without backlash, the commanded speed and nothing else, to add noise to."""
    v = np.full(samples, COMMANDED_SPEED_RPS)
    return Recording(dt * np.arange(samples), v, COMMANDED_SPEED_RPS, TURN_PERIOD_S, "constant speed")


def level_delta_rad(level: int) -> float:
    """Backlash of the authors' dataset K, (2K - 1)e-4 rad: Table 2's ten rows are K = 2 to 11."""
    return (2 * level - 1) * 1e-4


def authors_registry() -> dict[str, str]:
    """SHA-256 of each file of the authors' repository at `AUTHORS_COMMIT`, by its path there."""
    lines = (files("replication") / "data" / "authors_sha256.txt").read_text(encoding="utf-8").splitlines()
    return {path: digest for digest, path in (line.split("  ", 1) for line in lines)}


def data_folder() -> Path:
    """Folder that the authors' data are read from: what `BACKLASH_DATA` names, or else the download cache."""
    return Path(os.environ.get("BACKLASH_DATA") or pooch.os_cache("backlash-replication"))


def authors_file(path: str, base_url: str = AUTHORS_URL, cache: Path | None = None) -> Path:
    """Find one file of the authors' data and verify it.

    Looked for in the folder that the environment variable `BACKLASH_DATA` names; without that variable, in the
    download cache, and downloaded where it is not there yet.

    Parameters
    ----------
    path : str
        Path in the authors' repository.
    base_url : str
        Where to download from.
    cache : Path, optional
        Download folder; by default the user's cache folder.

    Returns
    -------
    Path

    Raises
    ------
    DataUnavailable
        The file is not in `BACKLASH_DATA`, or cannot be downloaded.
    DataCorrupt
        The file's SHA-256 is not the registered one; nothing is kept of a bad download.
    """
    registry = authors_registry()
    if path not in registry:
        raise DataUnavailable(f"{path}: no such file in the authors' repository at {AUTHORS_COMMIT[:7]}")
    local = os.environ.get("BACKLASH_DATA")
    if local:
        return _verified_local(Path(local) / path, registry[path])
    store = pooch.create(
        path=cache or data_folder(),
        base_url=base_url,
        registry={path: registry[path]},
        urls={path: base_url + quote(path)},
    )
    try:
        return Path(store.fetch(path, downloader=pooch.HTTPDownloader(timeout=20)))
    except ValueError as error:
        raise DataCorrupt(f"{path}: the download does not have the registered SHA-256; try again later") from error
    except OSError as error:
        raise DataUnavailable(
            f"{path}: cannot be downloaded ({type(error).__name__}); connect to the network, or set BACKLASH_DATA "
            "to a copy of the authors' repository"
        ) from error


def _verified_local(file: Path, digest: str) -> Path:
    """Check a local file against its registered SHA-256."""
    try:
        content = file.read_bytes()
    except OSError as error:
        raise DataUnavailable(f"{file}: not readable ({error.strerror}); is BACKLASH_DATA right?") from error
    if hashlib.sha256(content).hexdigest() != digest:
        raise DataCorrupt(f"{file}: its SHA-256 is not the registered one; copy it again")
    return file


def parse_speed_workbook(content: bytes, name: str) -> tuple[FloatArray, FloatArray]:
    """Read time and speed from the bytes of one of the authors' XLSX files.

    Blank rows are dropped, and so is a first row whose time stamp the second row repeats (it is no sample).

    Parameters
    ----------
    content : bytes
        The file.
    name : str
        What to call it in an error.

    Returns
    -------
    t, v : arrays of shape (samples,)
        Time [s] and motor speed [rps].

    Raises
    ------
    DataCorrupt
        It is no workbook, or does not hold two numeric columns on an even, increasing time grid.
    """
    try:
        frame = pd.read_excel(io.BytesIO(content), header=None).dropna(how="all")
        table = frame.to_numpy(dtype=float)
    except (ValueError, KeyError, OSError, zipfile.BadZipFile) as error:
        raise DataCorrupt(f"{name}: not a workbook of numbers ({error})") from error
    if table.ndim != 2 or table.shape[1] != 2 or table.shape[0] < 3 or not np.isfinite(table).all():
        raise DataCorrupt(f"{name}: expected two columns of finite numbers, found shape {table.shape}")
    if table[1, 0] == table[0, 0]:
        table = table[1:]
    t, v = table.T.copy()
    steps = np.diff(t)
    if not np.allclose(steps, steps.mean(), rtol=1e-6, atol=0) or steps.mean() <= 0:
        raise DataCorrupt(f"{name}: the time stamps are not on an even, increasing grid")
    return t, v


def _authors_recording(content: bytes, name: str) -> Recording:
    t, v = parse_speed_workbook(content, name)
    return Recording(t, v, COMMANDED_SPEED_RPS, TURN_PERIOD_S, name)


def load_clean(level: int) -> Recording:
    """Load the authors' noise-free record of level K (`SpeeddataK.xlsx`; K = 3 to 13 are public).

    Parameters
    ----------
    level : int
        K; the backlash is `level_delta_rad(level)`.

    Returns
    -------
    Recording

    Raises
    ------
    DataUnavailable, DataCorrupt
        See `authors_file` and `parse_speed_workbook`.
    """
    path = f"Speeddata{level}.xlsx"
    return _authors_recording(authors_file(path).read_bytes(), path)


def load_noisy(level: int, realisation: int) -> Recording:
    """Load one of the authors' noisy records.

    Parameters
    ----------
    level : int
        K, 1 to 20.
    realisation : int
        R: 1 to 5 at low noise, 11 to 20 at high noise.

    Returns
    -------
    Recording

    Raises
    ------
    DataUnavailable, DataCorrupt
        See `authors_file` and `parse_speed_workbook`; also a zip archive that is broken or lacks the record.
    """
    loudness = "Low" if realisation <= 5 else "High"
    path = f"Noisy data/{loudness} level of noise/Data_with_Noise_{realisation}.zip"
    content = read_zip_member(authors_file(path), rf"(.*/)?SpeeddataNoise{level}(_\d+)?\.xlsx")
    return _authors_recording(content, f"{path}!SpeeddataNoise{level}")


def read_zip_member(archive: Path, pattern: str) -> bytes:
    """Read the one member of a zip archive whose whole name matches a regular expression.

    Raises
    ------
    DataCorrupt
        The archive is broken, or not exactly one member matches.
    """
    try:
        with zipfile.ZipFile(archive) as bundle:
            names = [name for name in bundle.namelist() if re.fullmatch(pattern, name)]
            if len(names) != 1:
                raise DataCorrupt(f"{archive.name}: {len(names)} members match {pattern}, expected one")
            return bundle.read(names[0])
    except (zipfile.BadZipFile, EOFError, OSError) as error:
        raise DataCorrupt(f"{archive.name}: not a readable zip archive ({error})") from error
