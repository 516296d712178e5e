"""A reproducible workbook of "A virtual sensor for backlash in robotic manipulators"."""

import hashlib
import os
from pathlib import Path

# numba's cache knows when a file has changed, but not when one has whose functions it compiled into another's.
_FOLDER = Path(__file__).parent
_COMPILED = b"".join(text for path in sorted(_FOLDER.rglob("*.py")) if b"numba" in (text := path.read_bytes()))
os.environ.setdefault(
    "NUMBA_CACHE_DIR", str(_FOLDER / "__pycache__" / f"numba-{hashlib.sha256(_COMPILED).hexdigest()[:16]}")
)
