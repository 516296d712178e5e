"""What a run here left: a stamp, `.make/NAME.ran`, holds its seconds and the SHA-256 of each file that it made.

By the standard library alone: `make all` asks, each time, whether all of it is still there as it was made.
"""

import hashlib
import json
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any


def sha256_of(content: bytes) -> str:
    """SHA-256 of some bytes."""
    return hashlib.sha256(content).hexdigest()


def sha256(file: Path) -> str:
    """SHA-256 of a file; "" where none can be read."""
    try:
        return sha256_of(file.read_bytes())
    except OSError:
        return ""


def new_stamp(project: Path, files: Iterable[Path], seconds: float = 0.0) -> bytes:
    """Describe what was made in a project, as a stamp holds it."""
    made = {file.relative_to(project).as_posix(): sha256(file) for file in sorted(files)}
    return (json.dumps({"seconds": round(seconds), "made": made}, indent=1) + "\n").encode()


def read_stamp(stamp: Path) -> dict[str, Any]:
    """What a stamp holds; nothing where there is none."""
    try:
        held = json.loads(stamp.read_text("utf-8"))
        return {"seconds": float(held["seconds"]), "made": dict(held["made"])}
    except (OSError, ValueError, TypeError, KeyError):
        return {"seconds": 0, "made": {}}


def changed_files(project: Path, stamp: Path) -> list[str]:
    """Files that a run made, and that are gone or changed since; the stamp itself where it says nothing."""
    made = read_stamp(stamp)["made"]
    if not made:
        return [stamp.name]
    return [name for name, digest in made.items() if sha256(project / name) != digest]


def drop_outdated(project: Path) -> None:
    """Remove the stamps of runs whose files are no longer those that they made: they are due."""
    for stamp in (project / ".make").glob("*.ran"):
        if changed_files(project, stamp):
            stamp.unlink()


if __name__ == "__main__":
    if not os.access(".", os.W_OK):
        sys.exit("This folder is read-only: copy it to where you may write, then run make there")
    drop_outdated(Path.cwd())
