"""Notes which files a notebook's results are made from, and ends the kernel with its run.

The kernel executes this file by its path: what a notebook imports is what its results depend on,
and this is no part of them.
"""

import hashlib
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


def start(run: int, root: str, data: str, notebook: str) -> None:
    """Note the SHA-256 of each file below two folders when it is read; end with the process `run`."""
    threading.Thread(target=_end_with, args=(run,), daemon=True).start()
    sources: dict[str, str] = {}
    inputs: dict[str, str] = {}
    for file in (notebook, f"{root}/requirements.lock"):
        sources[_name_below(root, file) or Path(file).name] = _sha256(file)

    def note(event: str, arguments: tuple) -> None:
        file = _read_file(event, arguments)
        for folder, digests in ((root, sources), (data, inputs)):
            name = _name_below(folder, file)
            if name and name not in digests and os.path.isfile(file):
                digests[name] = ""  # hashing opens the file again
                digests[name] = _sha256(file)

    def write(outcome: str, variables: Mapping[str, object]) -> None:
        """Add to a notebook's outcome what it was made from."""
        seeds = {
            name: value
            for name, value in sorted(variables.items())
            if name.endswith(("seed", "seeds")) and isinstance(value, int | list | range)
        }
        made_from = {
            "sources": dict(sorted(sources.items())),
            "inputs": dict(sorted(inputs.items())),
            "python": platform.python_version(),
            "packages": {name: version(name) for name in PACKAGES if name in sys.modules},
            "seeds": seeds,
        }
        path = Path(outcome)
        exported = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        path.parent.mkdir(parents=True, exist_ok=True)
        content = json.dumps(
            exported | {"made_from": made_from}, indent=1, default=str
        )  # a range as text
        path.write_text(content + "\n", encoding="utf-8")

    sys.addaudithook(note)
    sys.modules["notebook_recorder"] = types.SimpleNamespace(write=write)  # type: ignore[assignment]


def _end_with(run: int) -> None:
    """Kill this kernel and its workers, one process group, when the process that started it is gone."""
    while os.getppid() == run:
        time.sleep(0.5)
    os.killpg(os.getpgid(0), signal.SIGKILL)


def _read_file(event: str, arguments: tuple) -> str:
    """File that is read: a module that is executed, or what is opened; a module's text is no data."""
    if event == "exec":
        return arguments[0].co_filename
    if event != "open" or not isinstance(arguments[0], str):
        return ""
    is_written = arguments[2] & (os.O_WRONLY | os.O_RDWR)
    return "" if is_written or arguments[0].endswith(".py") else arguments[0]


def _name_below(folder: str, file: str) -> str:
    """Name of a file as seen from a folder; empty if it lies elsewhere, or is hidden or a cache."""
    name = file.removeprefix(folder + os.sep)
    hidden = any(part.startswith((".", "__pycache__")) for part in Path(name).parts)
    return "" if name == file or hidden else name


def _sha256(file: str) -> str:
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()
