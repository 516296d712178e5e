"""Where the project is, and how its files are written: whole or not at all."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
QUICK = ROOT / "results" / "quick"
NOTEBOOKS = ROOT / "notebooks"
FLOAT_FORMAT = "%.6g"
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


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_bytes(content)
    os.replace(temporary, path)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all."""
    write_bytes(path, text.encode("utf-8"))


def write_csv(path: Path, table: "pd.DataFrame") -> None:
    """Write a table whole or not at all, six significant digits."""
    write_text(path, table.to_csv(index=False, float_format=FLOAT_FORMAT, lineterminator="\n"))


def write_json(path: Path, content: dict) -> None:
    """Write a JSON file whole or not at all."""
    write_text(path, json.dumps(content, indent=1) + "\n")
