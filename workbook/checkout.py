"""The checkout that the workbook works on: its notebooks, and the folder of a quick run."""

from pathlib import Path

from replication.files import ROOT

QUICK = ROOT / "results" / "quick"
NOTEBOOKS = ROOT / "notebooks"
PROJECT = 'name = "backlash-replication"'  # as its pyproject.toml has it


class NoCheckout(RuntimeError):
    """The package is installed without the project's notebooks and results around it."""

    exit_status = 2


def require_checkout(root: Path = ROOT) -> None:
    """Refuse a folder that is not the project's, such as that of an installed package."""
    project = root / "pyproject.toml"
    if not project.is_file() or PROJECT not in project.read_text(encoding="utf-8"):
        raise NoCheckout(f"{root} is not the project's folder: clone the project and run this command from its folder")


def notebook_files(ending: str, folder: Path = NOTEBOOKS) -> dict[str, Path]:
    """Files of the paper's notebooks and of those beyond it by name, in the order of their numbers."""
    found = [path for place in (folder, folder / "beyond") for path in place.glob(f"[0-9]*.{ending}")]
    return {path.stem: path for path in sorted(found, key=lambda path: path.name)}
