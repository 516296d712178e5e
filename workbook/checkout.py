"""The project's folder: its notebooks, and where their results go."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from replication.files import ROOT

NOTEBOOKS, RESULTS = ROOT / "notebooks", ROOT / "results"
QUICK = RESULTS / "quick"  # of a quick run, with results of its own
OFFLINE = RESULTS / "offline"  # likewise, of notebooks that ran without the authors' files
# What a page of such results says first.
APART = {
    QUICK: "This is a quick run with few repeats. The full report has the results.",
    OFFLINE: "On our simulated records in place of the authors', whose files could not be had. The "
    "committed results, from the authors' data, are untouched; `make data` fetches them.",
}


class CheckoutBusy(RuntimeError):
    """Another process writes into the same folder."""

    exit_status = 2


@contextmanager
def lock(folder: Path) -> Iterator[None]:
    """Keep other runs out of a folder for results, until this process ends, in whatever way."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".staging.lock").open("a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            file.seek(0)
            who = f"process {file.read()} makes the results of {folder}"
            raise CheckoutBusy(f"{who}; wait until it has ended") from error
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        yield


def results_folder(quick: bool) -> Path:
    """Folder of the results, or of the quick run's."""
    return QUICK / "results" if quick else RESULTS


def notebook_files(ending: str, folder: Path = NOTEBOOKS) -> dict[str, Path]:
    """Files of the paper's notebooks and of those beyond it by name, in the order of their numbers."""
    found = [
        path for place in (folder, folder / "beyond") for path in place.glob(f"[0-9]*.{ending}")
    ]
    return {path.stem: path for path in sorted(found, key=lambda path: path.name)}
