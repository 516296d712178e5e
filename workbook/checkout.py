"""The project's folders and its notebooks."""

from pathlib import Path

from replication.records import ROOT

NOTEBOOKS, RESULTS = ROOT / "notebooks", ROOT / "results"
OFFLINE = RESULTS / "offline"  # of notebooks that ran without the authors' files


def notebook_files(ending: str, folder: Path = NOTEBOOKS) -> dict[str, Path]:
    """Files of the paper's notebooks and of those beyond it by name, in the order of their numbers."""
    files = [*folder.glob(f"[0-9]*.{ending}"), *folder.glob(f"beyond/[0-9]*.{ending}")]
    return {path.stem: path for path in sorted(files, key=lambda path: path.name)}
