"""The project's folder: its notebooks, and where their results go."""

from pathlib import Path

from replication.files import ROOT

NOTEBOOKS, RESULTS = ROOT / "notebooks", ROOT / "results"
QUICK = RESULTS / "quick"  # of a quick run, with results of its own


def results_folder(quick: bool) -> Path:
    """Folder of the results, or of the quick run's."""
    return QUICK / "results" if quick else RESULTS


def notebook_files(ending: str, folder: Path = NOTEBOOKS) -> dict[str, Path]:
    """Files of the paper's notebooks and of those beyond it by name, in the order of their numbers."""
    found = [
        path for place in (folder, folder / "beyond") for path in place.glob(f"[0-9]*.{ending}")
    ]
    return {path.stem: path for path in sorted(found, key=lambda path: path.name)}
