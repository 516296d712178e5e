"""What every command needs, importing no library: errors that a user can mend, and files that are written whole."""

import errno
import hashlib
import json
import re
import secrets
import stat
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

    import pandas as pd

ROOT = Path(__file__).resolve().parents[1]


class UserError(Exception):
    """What a user can mend: the message is the one line that a command prints and a notebook shows."""

    exit_status = 2

    def _render_traceback_(self) -> list[str]:
        """What Jupyter shows in place of a traceback."""
        return [str(self)]


class DataUnavailable(UserError):
    """Public data cannot be downloaded, and no folder with them was named."""


class DataCorrupt(UserError):
    """The folder that was named, or a file of it, is not what it should be."""


# --------------------------------------------------------------------------- files: read whole, or not at all

Parsed = TypeVar("Parsed")
_MERGE_MARK = re.compile(r"^(<{7}|={7}|>{7})( |$)", re.MULTILINE)


def read_committed(file: "Traversable", parse: Callable[[str], Parsed]) -> Parsed:
    """Parse a text file that is committed; UserError where it is missing, cut, between two merges, or else damaged."""
    try:
        text = file.read_bytes().decode("utf-8")
        if not text.endswith("\n"):
            raise ValueError("its last line has no end")
        if mark := _MERGE_MARK.search(text):
            raise ValueError(f"a merge left its mark, {mark[0].strip()}")
        return parse(text)
    except Exception as error:  # of whatever a parser meets in a damaged file
        why = f"{type(error).__name__}: {error}".partition("\n")[0]
        raise UserError(
            f"{file}: damaged or missing ({why}); git checkout brings it back"
        ) from error


# ------------------------------------------------------------------------ files: written whole, or not at all

FLOAT_FORMAT = "%.6g"
DISK_IS_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def write_files(contents: Mapping[Path, bytes]) -> None:
    """Write files, all or none, each by one rename; a file that is replaced hands its mode on."""
    # Names that nobody knows before, opened as new: no link can stand there.
    temporary = {path: path.with_name(f".{secrets.token_hex(8)}.tmp") for path in contents}
    try:
        for path, content in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.is_dir():  # which no file replaces: before the first one is replaced
                raise IsADirectoryError(errno.EISDIR, "a folder stands in the place of", str(path))
            try:
                with temporary[path].open("xb") as file:
                    file.write(content)
            except OSError as error:  # of a full disk, which does not say where
                raise OSError(error.errno, error.strerror, str(path)) from error
            if path.is_file() and not path.is_symlink():
                temporary[path].chmod(stat.S_IMODE(path.stat().st_mode))
        for path in contents:
            temporary[path].replace(path)
    finally:
        for each in temporary.values():
            each.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file, by one rename."""
    write_files({path: content})


def write_text(path: Path, text: str) -> None:
    """Write a text file."""
    write_bytes(path, text.encode("utf-8"))


def as_csv(table: "pd.DataFrame") -> bytes:
    """A table as CSV, with six significant digits."""
    text: str = table.to_csv(index=False, float_format=FLOAT_FORMAT, lineterminator="\n")
    return text.encode()


def as_json(content: Mapping[str, Any]) -> bytes:
    """JSON, an entry a line."""
    return f"{json.dumps(content, indent=1)}\n".encode()


def write_csv(path: Path, table: "pd.DataFrame") -> None:
    """Write a table with six significant digits."""
    write_bytes(path, as_csv(table))


# Beside tables that `make all` does not make: the SHA-256 that each was written with.
KEPT_SHA256 = "kept_sha256.json"


def write_kept(path: Path, table: "pd.DataFrame") -> None:
    """Write a study's table, and beside it its SHA-256, by which one that is cut or changed is known later."""
    content, beside = as_csv(table), path.with_name(KEPT_SHA256)
    digests = _kept_sha256(beside) if beside.exists() else {}
    digests[path.name] = hashlib.sha256(content).hexdigest()
    write_files({path: content, beside: as_json(digests)})


def check_kept(path: Path) -> None:
    """Raise UserError if a table is not as `write_kept` wrote it."""
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if _kept_sha256(path.with_name(KEPT_SHA256)).get(path.name) != digest:
        raise UserError(f"{path}: not the table that its study wrote; git checkout brings it back")


def _kept_sha256(file: Path) -> dict[str, str]:
    """SHA-256 by table."""
    return read_committed(file, lambda text: dict(json.loads(text)))


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file."""
    write_bytes(path, as_json(content))
