"""Public files, found in a local folder or downloaded, and verified."""

import hashlib
import os
from pathlib import Path

from replication.files import UserError


class DataUnavailable(UserError):
    """The authors' data are neither in `BACKLASH_DATA` nor to be downloaded."""


class DataCorrupt(UserError):
    """A file of the authors' data is not what it should be."""


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
