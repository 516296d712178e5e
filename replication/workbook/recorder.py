"""Notes which files a notebook's results are made from, and ends the kernel with its run.

The kernel executes this file by its path.

It is not imported as a module of the package: what a notebook loads is what its results depend on, and this is no
part of them.
"""

import hashlib
import importlib.util
import json
import os
import platform
import signal
import sys
import threading
import time
import types
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("cma", "joblib", "matplotlib", "numba", "numpy", "openpyxl", "pandas", "scipy")
RECORDER = "notebook_recorder"  # its place in sys.modules


def start(folders: Mapping[str, str], run: int) -> None:
    """Note the SHA-256 of every file below some folders when it is opened for reading; end with the process `run`."""
    threading.Thread(target=_end_with, args=(run,), daemon=True).start()
    digests = {name: {} for name in folders}
    hashing = threading.local()

    def note(event, arguments):
        if event != "open" or getattr(hashing, "now", False) or not isinstance(arguments[0], str):
            return
        hashing.now = True
        try:
            for name, folder in folders.items():
                _note_file(digests[name], Path(folder), arguments[0], arguments[2])
        finally:
            hashing.now = False

    sys.addaudithook(note)
    sys.modules[RECORDER] = types.SimpleNamespace(folders=folders, digests=digests, write=write)


def _end_with(run: int) -> None:
    """Kill this kernel and its workers, which are one process group, when the parent that started it is gone."""
    while os.getppid() == run:
        time.sleep(0.5)
    os.killpg(os.getpgid(0), signal.SIGKILL)


def _note_file(digests: dict[str, str], folder: Path, opened: str, flags: int) -> None:
    """Keep a file's SHA-256, once, if it lies in the folder and is not opened for writing."""
    if not opened.startswith(str(folder)) or flags & (os.O_WRONLY | os.O_RDWR):
        return
    path = Path(opened)
    if path.parent.name == "__pycache__" and path.suffix == ".pyc":
        path = Path(importlib.util.source_from_cache(opened))
    inside = path.relative_to(folder)
    private = any(part.startswith((".", "__pycache__")) for part in inside.parts)
    if not private and str(inside) not in digests and path.is_file():
        digests[inside.as_posix()] = hashlib.sha256(path.read_bytes()).hexdigest()


def write(path: str, namespace: Mapping[str, object]) -> None:
    """Write what was noted, the versions of the packages and the seeds among a notebook's variables."""
    seeds = {name: value for name, value in namespace.items() if name.endswith(("seed", "seeds"))}
    loaded = {str(getattr(module, "__file__", "")) for module in list(sys.modules.values())}
    noted = sys.modules[RECORDER]
    record = {
        **{
            name: {file: digest for file, digest in sorted(files.items()) if _counts(noted.folders[name], file, loaded)}
            for name, files in noted.digests.items()
        },
        "python": platform.python_version(),
        "packages": {name: version(name) for name in PACKAGES if name in sys.modules},
        "seeds": {name: _plain(value) for name, value in sorted(seeds.items()) if _is_seed(value)},
    }
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def _counts(folder: str, file: str, loaded: set[str]) -> bool:
    """Whether results depend on a file that was read: of Python files only those that were loaded."""
    return not file.endswith(".py") or str(Path(folder) / file) in loaded


def _is_seed(value: object) -> bool:
    return isinstance(value, int) or (
        isinstance(value, list | tuple | range) and all(isinstance(item, int) for item in value)
    )


def _plain(value: int | list | tuple | range) -> int | str | list[int]:
    return str(value) if isinstance(value, range) else value if isinstance(value, int) else list(value)
