"""What the results are made from."""

import sys
from importlib.metadata import version
from typing import Any

from replication.records import AUTHORS_FILES, authors_checksums

PACKAGES = ("joblib", "matplotlib", "numba", "numpy", "openpyxl", "pandas", "scipy")


def provenance() -> dict[str, Any]:
    """Versions of Python and of the packages that compute; SHA-256 of the authors' files."""
    registry = authors_checksums()
    python = ".".join(map(str, sys.version_info[:2]))
    return {
        "versions": {"python": python} | {package: version(package) for package in PACKAGES},
        "authors_files": {file: registry[file] for file in AUTHORS_FILES},
    }
