"""Which notebooks are due: those that this checkout has not run yet, and those whose sources have changed since."""

import hashlib
import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from replication.files import ROOT, write_text
from workbook.checkout import notebook_files


def due(sources: Sequence[Path], destination: Path) -> list[Path]:
    """Choose the notebooks to run so that a folder's results are this checkout's own and of its sources."""
    changed = stale(destination / "results")
    return [
        source
        for source in sources
        if source.stem in changed or not _marker(source.stem, destination).exists()
    ]


def mark_as_run(name: str, destination: Path, begun: float) -> None:
    """Note that this checkout has run a notebook, unless a source of it was changed meanwhile."""
    files = [
        ROOT / file for file in _sources(destination / "results" / "outcomes" / f"{name}.json")
    ]
    if not any(file.stat().st_mtime > begun for file in files if file.exists()):
        write_text(_marker(name, destination), "")


def stale(results: Path) -> dict[str, list[str]]:
    """Find the notebooks whose sources have changed since their results were made, and which."""
    found = {}
    for outcome in sorted((results / "outcomes").glob("*.json")):
        changed = [name for name, noted in _sources(outcome).items() if _digest(name) != noted]
        if changed and outcome.stem in notebook_files("py"):
            found[outcome.stem] = changed
    return found


def _marker(name: str, destination: Path) -> Path:
    return destination / ".make" / f"{name}.ran"


def _sources(outcome: Path) -> dict[str, str]:
    """SHA-256 of what a notebook's kernel noted that it read, by name."""
    return json.loads(outcome.read_text("utf-8"))["made_from"]["sources"]


@cache
def _digest(name: str) -> str:
    file = ROOT / name
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else ""
