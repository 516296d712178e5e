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

import numba
import numpy as np
from numba.core import caching, config
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys
from numpy.typing import NDArray

_PACKAGE = Path(__file__).parents[1]
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
    if given := vars(config)["CACHE_DIR"]:
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
    return folder is None or not any(folder.glob("*.nbi"))


class _Locator(caching._CacheLocator):
    """What numba asks of a place for a function's compiled code."""

    def __init__(self, function: Callable):
        self._function = function

    def get_cache_path(self) -> str:
        return str(cache_folder())

    def get_source_stamp(self) -> str:
        return hash_code()

    def get_disambiguator(self) -> str:
        return f"{self._function.__module__}-{self._function.__code__.co_firstlineno}"

    @classmethod
    def from_function(cls, function: Callable, _: str) -> "_Locator":
        return cls(function)


class _Content(caching.CompileResultCacheImpl):
    _locator_classes: list[type[object]] = [_Locator]  # noqa: RUF012  as numba has it


class _Cache(caching.FunctionCache):
    _impl_class = _Content

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Load kept code with numba's memory management, but not what it needs to compile: 0.4 s."""
        rtsys.initialize(target)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target)

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep compiled code if there is room for it."""
        with suppress(OSError):
            super().save_overload(signature, compiled)


def njit(function: Callable | None = None, *, nogil: bool = False, inner: bool = False) -> Any:
    """Compile a function as `numba.njit` does, and keep the result.

    What only compiled code calls is `inner`: without its way in from Python it compiles a quarter faster.
    """
    if function is None:
        return partial(njit, nogil=nogil, inner=inner)
    options: dict[str, Any] = {
        "nogil": nogil,
        "no_cpython_wrapper": inner,
        "no_cfunc_wrapper": True,
    }
    compiled: Any = numba.njit(**options)(function)
    if cache_folder() is not None:
        compiled._cache = _Cache(function)
    return compiled


def keep_array(made_from: bytes, compute: Callable[[], NDArray]) -> NDArray:
    """What compiled code computes of some bytes, kept beside that code.

    The file's name holds code and processor: the last bits differ.
    """
    folder = cache_folder()
    if folder is None:
        return compute()
    machine = repr((hash_code(), cpu_target.target_context.codegen().magic_tuple()))
    path = folder / f"{hashlib.sha256(made_from + machine.encode()).hexdigest()[:16]}.npy"
    with suppress(OSError, EOFError, ValueError):  # not there yet, or broken off
        return np.load(path)
    array = compute()
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.npy")
    with suppress(OSError):
        np.save(temporary, array)
        os.replace(temporary, path)
    return array
