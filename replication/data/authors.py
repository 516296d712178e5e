"""The authors' files: found locally or downloaded, verified, and read."""

import hashlib
import io
import os
import re
import zipfile
from importlib.resources import files
from pathlib import Path
from urllib.parse import quote

import pandas as pd

from replication.arrays import FloatArray

AUTHORS_COMMIT = "7c81edefe3e61479d234d5080d4627dbbf584733"
AUTHORS_URL = f"https://raw.githubusercontent.com/ElianaGiovannitti/Backlash-estimation/{AUTHORS_COMMIT}/"
WORKBOOK_FILES = (
    *(f"Speeddata{level}.xlsx" for level in range(3, 14)),
    *(f"Noisy data/Low level of noise/Data_with_Noise_{realisation}.zip" for realisation in range(1, 6)),
)


class DataUnavailable(RuntimeError):
    """The authors' data are neither in `BACKLASH_DATA` nor to be downloaded."""

    exit_status = 2


class DataCorrupt(RuntimeError):
    """A file of the authors' data is not what it should be."""

    exit_status = 2


def authors_registry() -> dict[str, str]:
    """SHA-256 of each file of the authors' repository at `AUTHORS_COMMIT`, by its path there."""
    lines = (files("replication") / "data" / "authors_sha256.txt").read_text(encoding="utf-8").splitlines()
    return {path: digest for digest, path in (line.split("  ", 1) for line in lines)}


def data_folder() -> Path:
    """Folder that the authors' data are read from: what `BACKLASH_DATA` names, or else the download cache."""
    import pooch  # slow to import, and not used by the sensor

    return Path(os.environ.get("BACKLASH_DATA") or pooch.os_cache("backlash-replication"))


def authors_file(path: str, base_url: str = AUTHORS_URL, cache: Path | None = None) -> Path:
    """Find one file of the authors' data and verify it.

    Looked for in the folder that the environment variable `BACKLASH_DATA` names; without that variable, in the
    download cache, and downloaded where it is not there yet.
    """
    registry = authors_registry()
    if path not in registry:
        raise DataUnavailable(f"{path}: no such file in the authors' repository at {AUTHORS_COMMIT[:7]}")
    if local := os.environ.get("BACKLASH_DATA"):
        return _verified_local(Path(local) / path, registry[path])
    import pooch  # slow to import, and not used by the sensor

    address, downloader = base_url + quote(path), pooch.HTTPDownloader(timeout=20)
    try:
        return Path(pooch.retrieve(address, registry[path], path, cache or data_folder(), downloader=downloader))
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


def parse_speed_workbook(content: bytes) -> tuple[FloatArray, FloatArray]:
    """Read time and speed from the bytes of one of the authors' XLSX files, which `authors_file` has verified.

    Blank rows are dropped, and so is a first row whose time stamp the second row repeats (it is no sample).
    """
    table = pd.read_excel(io.BytesIO(content), header=None).dropna(how="all").to_numpy(dtype=float)
    t, v = table[1:].T.copy() if table[1, 0] == table[0, 0] else table.T.copy()
    return t, v


def read_zip_member(archive: Path, pattern: str) -> bytes:
    """Read the one member of a zip archive whose whole name matches a regular expression."""
    with zipfile.ZipFile(archive) as bundle:
        (member,) = (name for name in bundle.namelist() if re.fullmatch(pattern, name))
        return bundle.read(member)
