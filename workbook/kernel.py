"""What each kernel of a run does before its first cell: it watches the run, what is read and what is printed."""

import logging
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from workbook.project import ROOT, SETTINGS
from workbook.stamps import sha256

MOST_PRINTED = 2**20  # characters, by one notebook
READ = ".read"
HIDDEN = re.compile(r"(^|/)(\.|__pycache__)")


def load_ipython_extension(shell: Any) -> None:
    """Prepare a kernel that has this file as an extension."""
    end_with_run()
    # Else the first figure of a checkout says on stderr that a list of fonts is made.
    fonts = logging.getLogger("matplotlib.font_manager")
    fonts.addFilter(lambda record: "building the font cache" not in record.getMessage())
    note_reads(Path(os.environ["REPLICATION_OUT"], READ))
    for stream in (sys.stdout, sys.stderr):
        bound_output(stream, sys.stderr.write)


def end_with_run() -> None:
    """Kill this kernel and its workers when the process that started it has ended, however it did.

    In compiled code, when that returns.
    """
    parent = int(os.environ["JPY_PARENT_PID"])

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os.killpg(0, signal.SIGKILL)

    threading.Thread(target=watch, daemon=True).start()


def note_reads(notes: Path) -> None:
    """Note each file of the project that is opened, with its SHA-256 then, but for packages and what is hidden.

    Whatever lies in a folder of data that the environment names is verified by whoever reads it.
    """
    outside = [os.environ.get(name) for name in SETTINGS.get("folders", ())]
    others = [*filter(None, outside), *(ROOT / name for name in SETTINGS.get("packages", ()))]
    seen: set[Path] = set()

    def note(event: str, arguments: tuple[Any, ...]) -> None:
        if event != "open" or not isinstance(arguments[0], str):
            return
        path = Path(os.path.abspath(arguments[0]))
        if path in seen or not path.is_relative_to(ROOT) or any(map(path.is_relative_to, others)):
            return
        seen.add(path)
        name = path.relative_to(ROOT).as_posix()
        if not HIDDEN.search(name):
            with notes.open("a", encoding="utf-8") as file:
                file.write(f"{name} {sha256(path)}\n")

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
