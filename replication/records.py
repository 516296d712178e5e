"""Records of motor speed: their type, the noise added to them (equations 18 and 19), the authors' files.

The authors' files are read from the folder that the environment variable BACKLASH_DATA names, or else downloaded; each
is verified. Where they cannot be had, whoever runs notebooks sets BACKLASH_RECORDS=simulated: then records of our own
joint take their place, which every result says.
"""

import hashlib
import io
import os
import re
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from urllib.parse import quote
from xml.etree import ElementTree

import numpy as np

from replication import published
from replication.files import DataCorrupt, DataUnavailable, read_committed
from replication.joint import identified_joint, simulate
from replication.signature import FloatArray

COMMANDED_SPEED_RPS = 100.0  # v_t of the paper's movement
TURN_PERIOD_S = 0.4  # of the load in the records; Table 1 prints 0.408
SAMPLE_S = 2e-3
RPM_PER_RPS = 60.0

# Levels K of the authors' data: those published clean and noisy, and realisations R of the noise
# whose amplitudes Table 2 prints.
CLEAN_LEVELS = range(3, 14)
NOISY_LEVELS = range(1, 21)
LOW_NOISE = range(1, 6)


@dataclass(frozen=True)
class Recording:
    """An evenly sampled record of a joint's motor speed during the test movement."""

    t: FloatArray  # time [s], shape (samples,)
    v: FloatArray  # motor speed [rps], shape (samples,)
    commanded_speed_rps: float  # v_t of equation 11
    turn_period_s: float  # of the load
    source: str  # where it comes from

    @property
    def sample_s(self) -> float:
        """Sampling period [s]."""
        return float(self.t[-1] - self.t[0]) / (self.t.size - 1)


# -------------------------------------------------------------------------------------------------- noise


def level_delta_rad(level: int) -> float:
    """Backlash of the authors' dataset K, (2 K - 1) 1e-4 rad: Table 2's ten rows are K = 2 to 11."""
    return (2 * level - 1) * 1e-4


def noise_half_amplitude_rps(level: int) -> float:
    """Half-amplitude a_K of the authors' noise, Table 2's second column: (A_n - A_min) / (2 dA) of equation 19 (E4)."""
    return 0.1 + (level - 1) * 0.15 / 19


def draw_noise(half_amplitude_rps: float, samples: int, rng: np.random.Generator) -> FloatArray:
    """Equation 19: white noise of 2 a U(-0.5, 0.5), with the half-amplitude a; shape (samples,)."""
    return rng.uniform(-half_amplitude_rps, half_amplitude_rps, samples)  # equation 19


def add_noise(
    recording: Recording, half_amplitude_rps: float, rng: np.random.Generator
) -> Recording:
    """Equation 18: a record with the noise of equation 19."""
    noise = draw_noise(half_amplitude_rps, recording.v.size, rng)
    v_n = recording.v + noise  # equation 18
    return replace(recording, v=v_n, source=f"{recording.source} + uniform noise")


def constant_speed() -> Recording:
    """A record of twelve turns without backlash and noise: the commanded speed and nothing else."""
    t = SAMPLE_S * np.arange(2401, dtype=float)
    v = np.full(t.size, COMMANDED_SPEED_RPS)
    return Recording(t, v, COMMANDED_SPEED_RPS, TURN_PERIOD_S, "constant speed")


@cache
def simulate_clean(level: int) -> Recording:
    """Record of our identified joint in place of the authors' of level K, to five significant digits as theirs are."""
    run = simulate(identified_joint(), level_delta_rad(level), step=5e-5)
    source = f"simulated joint, level {level}"
    return Recording(run.t, run.v.round(2), COMMANDED_SPEED_RPS, TURN_PERIOD_S, source)


# ------------------------------------------------------------------------------------- the authors' files

AUTHORS_COMMIT = "7c81edefe3e61479d234d5080d4627dbbf584733"
AUTHORS_URL = (
    f"https://raw.githubusercontent.com/ElianaGiovannitti/Backlash-estimation/{AUTHORS_COMMIT}/"
)
NOISY_ARCHIVE = "Noisy data/Low level of noise/Data_with_Noise_{}.zip"
AUTHORS_FILES = (
    *(f"Speeddata{level}.xlsx" for level in CLEAN_LEVELS),
    *(NOISY_ARCHIVE.format(realisation) for realisation in LOW_NOISE),
)


def authors_checksums() -> dict[str, str]:
    """SHA-256 of each file of the authors' repository at `AUTHORS_COMMIT`, by its path there."""

    def parse(text: str) -> dict[str, str]:
        pairs = (line.split("  ", 1) for line in text.splitlines())
        registered = {path: digest for digest, path in pairs}
        return registered | {path: registered[path] for path in AUTHORS_FILES}  # none lacks

    return read_committed(published.DATA / "authors_sha256.txt", parse)


def needed_checksums() -> dict[str, str]:
    """SHA-256 of the files that the notebooks read, by their path in the authors' repository."""
    registered = authors_checksums()
    return {path: registered[path] for path in AUTHORS_FILES}


def authors_file(path: str) -> Path:
    """Find one file of the authors' data, by its path in their repository, or download it."""
    return public_file(AUTHORS_URL + quote(path), path, authors_checksums()[path], "BACKLASH_DATA")


def public_file(address: str, name: str, sha256: str, variable: str) -> Path:
    """Find a public file by its name in the folder that an environment variable names, or else download it.

    Raises
    ------
    DataCorrupt
        The variable is set, and the file is not there or not the registered one; or the download is not.
    DataUnavailable
        The variable is not set, and there is no network, or no folder to download to: it names the cause.
    """
    if folder := os.environ.get(variable):
        file = Path(folder).expanduser() / name
        try:
            content = file.read_bytes() if file.is_file() else None
        except OSError:
            content = None
        if content is None:
            raise DataCorrupt(f"{file}: not there or not readable; is {variable} right?")
        if hashlib.sha256(content).hexdigest() != sha256:
            raise DataCorrupt(f"{file}: its SHA-256 is not the registered one; copy it again")
        return file
    import pooch  # slow to import, and not needed where the variable is set

    cached = pooch.os_cache("backlash-replication")
    try:
        downloader = pooch.HTTPDownloader(timeout=20)
        return Path(pooch.retrieve(address, sha256, name, cached, downloader=downloader))
    except (OSError, ValueError) as error:
        if "does not match the known hash" in str(error):
            raise DataCorrupt(f"{name}: the download is not the registered file") from error
        raise DataUnavailable(
            f"{name}: not downloaded to {cached}: {_root_cause(error)}; "
            f"mend that, or set {variable} to a folder with a copy"
        ) from error


def _root_cause(error: BaseException) -> str:
    """What an error of a download began with, in one line."""
    inner: BaseException | None = error
    while inner is not None:
        error = inner
        reason = getattr(error.args[0], "reason", None) if error.args else None
        inner = reason if isinstance(reason, BaseException) else None
    text = " ".join(str(error).split())
    return text.rpartition(">: ")[2] or type(error).__name__


_SHEETS = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"  # before a tag's name


@cache  # of a whole file's bytes, so of a file that is verified
def _read_worksheet(workbook: bytes) -> FloatArray:
    """Numbers of the first sheet of an XLSX file that holds numbers alone; shape (rows, columns)."""
    with zipfile.ZipFile(io.BytesIO(workbook)) as parts:
        sheet = ElementTree.fromstring(parts.read("xl/worksheets/sheet1.xml"))
    rows = [
        [float(value.text or "nan") for value in row.iter(f"{_SHEETS}v")]
        for row in sheet.iter(f"{_SHEETS}row")
    ]
    return np.array([row for row in rows if row])


def _authors_recording(workbook: bytes, source: str) -> Recording:
    table = _read_worksheet(workbook)
    repeated = int(table[1, 0] == table[0, 0])  # of R = 1, K = 1: its first row is no sample
    t, v = table[repeated:].T.copy()
    return Recording(t, v, COMMANDED_SPEED_RPS, TURN_PERIOD_S, source)


def records_are_simulated() -> bool:
    """Whether our joint's records take the place of the authors'."""
    return os.environ.get("BACKLASH_RECORDS") == "simulated"


def load_clean(level: int) -> Recording:
    """Load the noise-free record of level K; the authors' K = 3 to 13 are public."""
    if records_are_simulated():
        return simulate_clean(level)
    if level not in CLEAN_LEVELS:
        raise ValueError(f"no clean record K = {level} is public: K is 3 to 13")
    path = f"Speeddata{level}.xlsx"
    return _authors_recording(authors_file(path).read_bytes(), path)


def load_clean_records(levels: Iterable[int]) -> dict[float, Recording]:
    """Load the clean records of some levels K, by backlash [rad]."""
    return {level_delta_rad(level): load_clean(level) for level in levels}


def load_noisy(level: int, realisation: int) -> Recording:
    """Load the noisy record of a level K, 1 to 20, and a realisation R of the low noise, 1 to 5."""
    if level not in NOISY_LEVELS or realisation not in LOW_NOISE:
        raise ValueError(
            f"no noisy record K = {level}, R = {realisation}: K is 1 to 20, R is 1 to 5"
        )
    if records_are_simulated():
        rng = np.random.default_rng((realisation, level))
        return add_noise(simulate_clean(level), noise_half_amplitude_rps(level), rng)
    path = NOISY_ARCHIVE.format(realisation)
    with zipfile.ZipFile(authors_file(path)) as archive:
        member = rf"(.*/)?SpeeddataNoise{level}(_\d+)?\.xlsx"
        (name,) = (each for each in archive.namelist() if re.fullmatch(member, each))
        content = archive.read(name)
    return _authors_recording(content, f"{path}!{name}")
