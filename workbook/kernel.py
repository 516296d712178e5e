"""What each kernel of a run does before its first cell: it notes what is read, and bounds what is printed."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from workbook.project import ROOT, SETTINGS
from workbook.stamps import sha256

MOST_PRINTED = 2**20  # characters, by one notebook
READ = ".read"


def load_ipython_extension(shell: Any) -> None:
    """Note the files that are read, and bound what is printed: of a kernel that has this file as an extension."""
    note_reads(Path(os.environ["REPLICATION_OUT"], READ))
    bound_output(sys.stdout, sys.stderr.write)
    bound_output(sys.stderr, sys.stderr.write)


def note_reads(notes: Path) -> None:
    """Note each file of the project that is opened, with its SHA-256 then, but for packages and what is hidden.

    Whatever lies in a folder of data that the environment names is verified by whoever reads it.
    """
    outside = [os.environ.get(name) for name in SETTINGS.get("folders", ())]
    others = [Path(each) for each in (sys.prefix, *filter(None, outside))]
    seen: set[Path] = set()

    def note(event: str, arguments: tuple[Any, ...]) -> None:
        if event != "open" or not isinstance(arguments[0], str):
            return
        path = Path(os.path.abspath(arguments[0]))
        if path in seen or ROOT not in path.parents or any(each in path.parents for each in others):
            return
        seen.add(path)
        name = path.relative_to(ROOT)
        is_hidden = any(part.startswith((".", "__pycache__")) for part in name.parts)
        if not is_hidden and name.parts[0] not in SETTINGS.get("packages", ()):
            with notes.open("a", encoding="utf-8") as file:
                file.write(f"{name.as_posix()} {sha256(path)}\n")

    sys.addaudithook(note)


def read_notes(notes: Path) -> dict[str, str]:
    """SHA-256 of what was read, by name, as it was when it was read first."""
    lines = notes.read_text("utf-8").splitlines() if notes.exists() else []
    return dict(line.rsplit(" ", 1) for line in reversed(lines))


def bound_output(stream: Any, complain: Callable[[str], Any]) -> None:
    """Drop what is printed beyond a length, and say so once on stderr, which fails the run."""
    write, left = stream.write, MOST_PRINTED

    def write_some(text: str) -> int:
        nonlocal left
        before, left = left, left - len(text)
        if left >= 0:
            return write(text)
        if before >= 0:
            complain(f"more than {MOST_PRINTED} characters are printed\n")
        return len(text)

    stream.write = write_some
