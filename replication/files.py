"""What every command needs, and no library: errors that a user can mend, and files that are written whole."""

import json
import secrets
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
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


# ------------------------------------------------------------------------ files: written whole, or not at all

FLOAT_FORMAT = "%.6g"


def write_files(contents: Mapping[Path, bytes]) -> None:
    """Write files, all or none, each by one rename; a file that is replaced hands its mode on."""
    # Names that nobody knows before, opened as new: no link can stand there.
    temporary = {path: path.with_name(f".{secrets.token_hex(8)}.tmp") for path in contents}
    try:
        for path, content in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            with temporary[path].open("xb") as file:
                file.write(content)
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
    return table.to_csv(index=False, float_format=FLOAT_FORMAT, lineterminator="\n").encode()


def as_json(content: dict) -> bytes:
    """JSON, an entry a line."""
    return f"{json.dumps(content, indent=1)}\n".encode()


def write_csv(path: Path, table: "pd.DataFrame") -> None:
    """Write a table with six significant digits."""
    write_bytes(path, as_csv(table))


# Beside tables that `make all` does not make: how many rows each was written with.
KEPT_ROWS = "kept_rows.json"


def write_kept(path: Path, table: "pd.DataFrame") -> None:
    """Write a study's table, and beside it how many rows it has, by which one that is cut is known later."""
    rows = _kept_rows(path.parent) | {path.name: len(table)}
    write_files({path: as_csv(table), path.with_name(KEPT_ROWS): as_json(rows)})


def check_kept(path: Path, table: "pd.DataFrame") -> None:
    """Raise UserError if a table that was written by `write_kept` has other rows than then, or none."""
    rows = _kept_rows(path.parent).get(path.name, len(table))
    if table.empty or len(table) != rows:
        raise UserError(f"{path}: {len(table)} of {rows} rows; git checkout brings it back")


def _kept_rows(folder: Path) -> dict[str, int]:
    """Rows by table; none is known where nothing was written yet."""
    file = folder / KEPT_ROWS
    try:
        return dict(json.loads(file.read_text("utf-8"))) if file.exists() else {}
    except (ValueError, TypeError) as error:
        raise UserError(
            f"{file}: no JSON of tables and their rows ({error}); git checkout brings it back"
        ) from error


def write_json(path: Path, content: dict) -> None:
    """Write a JSON file."""
    write_bytes(path, as_json(content))
