"""The project that the machine works on: its folder, its settings and its notebooks.

By the standard library alone: `make all` asks, each time, what is due.
"""

import re
import tomllib
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from replication.files import UserError


def find_root() -> Path:
    """Find the folder whose pyproject.toml has a table tool.workbook: this one, one above it, or the machine's."""
    there = Path.cwd()
    for folder in (there, *there.parents, Path(__file__).parents[1]):
        if read_settings(folder):
            return folder
    raise UserError(f"{there}: no pyproject.toml with a table [tool.workbook], here or above")


def read_settings(folder: Path) -> dict[str, Any]:
    """Read the table tool.workbook of a folder's pyproject.toml; empty where there is none."""
    file = folder / "pyproject.toml"
    try:
        return tomllib.loads(file.read_text("utf-8")).get("tool", {}).get("workbook", {})
    except FileNotFoundError:
        return {}
    except (ValueError, OSError) as error:
        raise UserError(f"{file}: {error}; git checkout brings it back") from error


ROOT = find_root()
RESULTS = ROOT / "results"
SETTINGS = read_settings(ROOT)
SIMULATED = SETTINGS.get("simulated", {})  # what takes the place of data that cannot be had


def find_hook(name: str, default: Any = None) -> Any:
    """Find what the settings name as "module:function", code of the project; a default where they name nothing."""
    return resolve_name(SETTINGS[name]) if name in SETTINGS else default


def notebook_sources() -> dict[str, Path]:
    """Sources of the notebooks by name, in the order of their numbers.

    Raises
    ------
    UserError
        A name is not a number and a word, as that of a copy that a cloud made, or two folders have the same.
    """
    files = [*ROOT.glob("notebooks/[0-9]*.py"), *ROOT.glob("notebooks/[!.]*/[0-9]*.py")]
    sources: dict[str, Path] = {}
    for path in sorted(files, key=lambda path: path.name):
        if not re.fullmatch(r"\d+_\w+", path.stem, re.ASCII):
            raise UserError(f"{path}: a copy? A notebook is named NN_name.py; rename or remove it")
        if path.stem in sources:
            raise UserError(f"{path}: {sources[path.stem]} has the same name; rename one")
        sources[path.stem] = path
    return sources
