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
    changed = stale(destination / "results")
    return [
        source
        for source in sources
        if source.stem in changed or not marker(source.stem, destination).exists()
    ]


def stale(results: Path) -> dict[str, list[str]]:
    """Find the notebooks whose sources have changed since their results were made, and which."""
    found = {}
    for outcome in sorted((results / "outcomes").glob("*.json")):
        sources = json.loads(outcome.read_text("utf-8"))["made_from"]["sources"]
        changed = [name for name, noted in sources.items() if _digest(name) != noted]
        if changed and outcome.stem in notebook_files("py"):
            found[outcome.stem] = changed
    return found


def marker(name: str, destination: Path) -> Path:
    """File that says that this checkout has run a notebook."""
    return destination / ".make" / f"{name}.ran"


@cache
def _digest(name: str) -> str:
    file = ROOT / name
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else ""
