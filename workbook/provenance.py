"""What the results are made from, and what a rerun of them says."""

import hashlib
import platform
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

from llvmlite import binding

from replication.records import AUTHORS_FILES, authors_checksums
from workbook import judging

PACKAGES = ("joblib", "matplotlib", "numba", "numpy", "openpyxl", "pandas", "scipy")


def provenance() -> dict[str, Any]:
    """Versions of Python and of the packages that compute; SHA-256 of the authors' files."""
    registry = authors_checksums()
    python = ".".join(map(str, sys.version_info[:2]))
    return {
        "versions": {"python": python} | {package: version(package) for package in PACKAGES},
        "authors_files": {file: registry[file] for file in AUTHORS_FILES},
    }


def manifest(results: Path) -> dict[str, Any]:
    """What a reader can send back: versions, processor, hashes of the results, the verdicts."""
    files = sorted([*results.glob("*.csv"), results / "report.md"])
    return provenance() | {
        "system": f"{platform.platform()}, Python {platform.python_version()}",
        "processor": binding.get_host_cpu_name(),
        "results": {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files},
        "verdicts": judging.verdicts(results).set_index("id")["agreement"].to_dict(),
    }
