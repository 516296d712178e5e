"""Where compiled code is kept: our own functions alone, in a folder of their own.

numba knows when a file has changed, but not when one has whose functions it compiled into another's. So the folder is
that of one state of all files that compile.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba

config: Any = numba.config
_PACKAGE = Path(__file__).parent
_PACKAGES = ("replication", "backlash", "studies")


@lru_cache(maxsize=1)
def hash_code() -> str:
    """Hash of all files that compile."""
    paths = [path for name in _PACKAGES for path in sorted(_PACKAGE.with_name(name).rglob("*.py"))]
    texts = (path.read_bytes() for path in paths)
    return hashlib.sha256(b"".join(text for text in texts if b"njit" in text)).hexdigest()[:16]


@lru_cache(maxsize=1)
def cache_folder() -> Path | None:
    """The folder that numba was told, or the first that can be written and no other user writes; else None.

    Its name holds the code's state: numba cannot even read what a renamed class was kept with.
    """
    state = f"numba-{hash_code()}"
    if given := config.CACHE_DIR:
        return Path(given) / state
    return next((folder / state for folder in _candidates() if _is_ours(folder / state)), None)


def _candidates() -> Iterator[Path]:
    yield _PACKAGE / "__pycache__"
    with suppress(RuntimeError):  # no home
        yield Path.home() / ".cache" / "backlash"
    with suppress(OSError):
        yield Path(tempfile.gettempdir()) / f"backlash-{_user()}"


def _user() -> int:
    return os.getuid() if hasattr(os, "getuid") else 0


def _is_ours(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
    except OSError:
        return False
    return os.access(folder, os.W_OK) and status.st_uid == _user() and not status.st_mode & 0o002


def is_empty() -> bool:
    """Whether nothing has been compiled yet."""
    folder = cache_folder()
    return folder is None or not any(folder.rglob("*.nbi"))


def processor() -> str:
    """The processor that code is compiled for."""
    host = llvmlite.binding.get_host_cpu_name()
    return f"{config.CPU_NAME or host} {config.CPU_FEATURES}"


def njit(function: Callable | None = None, *, nogil: bool = False, inner: bool = False) -> Any:
    """Compile a function as `numba.njit` does, and keep the result.

    What only compiled code calls is `inner`: without its way in from Python it compiles a quarter faster.
    """
    if function is None:
        return partial(njit, nogil=nogil, inner=inner)
    folder, given = cache_folder(), config.CACHE_DIR
    options: dict[str, Any] = {
        "cache": folder is not None,
        "nogil": nogil,
        "no_cpython_wrapper": inner,
        "no_cfunc_wrapper": True,
    }
    config.CACHE_DIR = str(folder)
    try:
        return numba.njit(**options)(function)
    finally:
        config.CACHE_DIR = given
