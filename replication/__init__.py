"""A reproducible workbook of "A virtual sensor for backlash in robotic manipulators"."""

import hashlib
import os
from pathlib import Path

# numba's cache knows when a file has changed, but not when one has whose functions it compiled into another's.
_FOLDER = Path(__file__).parent
_PACKAGES = (_FOLDER, _FOLDER.with_name("backlash"), _FOLDER.with_name("studies"))
_FILES = sorted(path for package in _PACKAGES for path in package.rglob("*.py"))
_COMPILED = b"".join(text for path in _FILES if b"numba" in (text := path.read_bytes()))
CODE_HASH = hashlib.sha256(_COMPILED).hexdigest()[:16]
_CACHE = _FOLDER / "__pycache__" if os.access(_FOLDER, os.W_OK) else Path.home() / ".cache" / "backlash"
os.environ.setdefault("NUMBA_CACHE_DIR", str(_CACHE / f"numba-{CODE_HASH}"))
