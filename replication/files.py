"""What every command needs, and no library: errors that a user can mend, and files that are written whole."""

import json
import secrets
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


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file, by one rename."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # A name that nobody knows before, opened as new: no link can stand there.
    temporary = path.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(content)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file."""
    write_bytes(path, text.encode("utf-8"))


def write_csv(path: Path, table: "pd.DataFrame") -> None:
    """Write a table with six significant digits."""
    write_text(path, table.to_csv(index=False, float_format=FLOAT_FORMAT, lineterminator="\n"))


def write_json(path: Path, content: dict) -> None:
    """Write a JSON file."""
    write_text(path, json.dumps(content, indent=1) + "\n")
