"""What the results are made from: versions, SHA-256 of the authors' files, seeds; and what a rerun of them says."""

import hashlib
import platform
import re
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jupytext
from llvmlite import binding

from replication.records import AUTHORS_FILES, authors_checksums
from workbook import judging
from workbook.outcomes import notebook_files

PACKAGES = ("joblib", "matplotlib", "numba", "numpy", "openpyxl", "pandas", "scipy")


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
    cells = jupytext.read(source).cells
    tagged = [cell.source for cell in cells if "parameters" in cell.metadata.get("tags", [])]
    return dict(re.findall(r"^(\w*seeds?) = (.+?)(?:  #.*)?$", "\n".join(tagged), re.MULTILINE))


def manifest(results: Path) -> dict[str, Any]:
    """What a reader can send back: versions, processor, hashes of the results, the verdicts."""
    verdicts = judging.verdicts(results)
    files = sorted([*results.glob("*.csv"), results / "report.md"])
    return provenance() | {
        "system": f"{platform.platform()}, Python {platform.python_version()}",
        "processor": binding.get_host_cpu_name(),
        "results": {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files},
        "verdicts": verdicts["agreement"].value_counts().to_dict(),
        "differs": verdicts.loc[verdicts["agreement"] == "differs", "id"].tolist(),
    }
