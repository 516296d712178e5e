"""What the results are made from: versions, SHA-256 of the authors' files, seeds."""

import ast
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jupytext

from replication.records import AUTHORS_FILES, authors_checksums
from workbook.checkout import notebook_files

PACKAGES = ("cma", "joblib", "matplotlib", "numba", "numpy", "openpyxl", "pandas", "scipy")


def provenance() -> dict[str, Any]:
    """Versions of Python and the packages that compute, SHA-256 by file, seeds by notebook."""
    registry = authors_checksums()
    python = ".".join(map(str, sys.version_info[:2]))
    return {
        "versions": {"python": python} | {package: version(package) for package in PACKAGES},
        "authors_files": {file: registry[file] for file in AUTHORS_FILES},
        "seeds": {name: seeds(source) for name, source in notebook_files("py").items()},
    }


def seeds(source: Path) -> dict[str, str]:
    """Seeds that a notebook's parameters give, as they are written there."""
    tagged = [
        cell.source
        for cell in jupytext.read(source).cells
        if "parameters" in cell.metadata.get("tags", [])
    ]
    return {
        target.id: ast.unparse(node.value)
        for node in ast.parse("\n".join(tagged)).body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name) and target.id.endswith(("seed", "seeds"))
    }
