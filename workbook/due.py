"""Which notebooks are due: those that this checkout has not run yet, and those whose sources have changed since."""

import hashlib
import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from replication.files import ROOT
from workbook.checkout import notebook_files


def due(sources: Sequence[Path], destination: Path) -> list[Path]:
    """Choose the notebooks to run so that a folder's results are this checkout's own and of its sources."""
    return [
        source
        for source in sources
        if not _marker(source.stem, destination).exists()
        or not _outcome(source.stem, destination / "results").exists()
        or _changed(_outcome(source.stem, destination / "results"))
    ]


def mark_as_run(name: str, destination: Path, begun: float) -> None:
    """Note that this checkout has run a notebook, unless a source of it was changed meanwhile."""
    sources = _sources(_outcome(name, destination / "results"))
    if not any((ROOT / file).stat().st_mtime > begun for file in sources if (ROOT / file).exists()):
        marker = _marker(name, destination)
        marker.parent.mkdir(exist_ok=True)
        marker.touch()


def stale(results: Path) -> dict[str, list[str]]:
    """Find the notebooks whose sources have changed since their results were made, and which."""
    outcomes = {name: _outcome(name, results) for name in notebook_files("py")}
    found = {name: _changed(file) for name, file in outcomes.items() if file.exists()}
    return {name: changed for name, changed in found.items() if changed}


def _marker(name: str, destination: Path) -> Path:
    return destination / ".make" / f"{name}.ran"


def _outcome(name: str, results: Path) -> Path:
    return results / "outcomes" / f"{name}.json"


def _sources(outcome: Path) -> dict[str, str]:
    """SHA-256 of what a notebook's kernel noted that it read, by name."""
    return json.loads(outcome.read_text("utf-8"))["made_from"]["sources"]


def _changed(outcome: Path) -> list[str]:
    return [name for name, digest in _sources(outcome).items() if _digest_now(name) != digest]


@cache
def _digest_now(name: str) -> str:
    file = ROOT / name
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else ""
