"""Machine code for functions that take long, the same on each processor: numba's compiler, and what pins it."""

import ctypes
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from replication.files import UserError


def njit(function: Callable[..., Any], fastmath: set[str] | bool = False) -> Any:
    """Compile a function; its machine code is kept where a folder for it can be written."""
    try:
        with warnings.catch_warnings():
            # A setting that it cannot read it leaves, and prints a traceback.
            warnings.filterwarnings("error", "Environment variable", RuntimeWarning)
            import numba  # slow, and not every command computes
    except Exception as error:  # whatever a setting of the user's makes it raise
        why = " ".join(str(error).partition("The parse failed")[0].split())
        where = "the variables NUMBA_... and the file .numba_config.yaml"
        raise UserError(f"numba does not start: {why}; see {where}") from error
    try:
        return numba.njit(cache=True, nogil=True, fastmath=fastmath)(function)
    except RuntimeError:  # no folder for the cache
        return numba.njit(nogil=True, fastmath=fastmath)(function)


def njit_sums(function: Callable[..., Any]) -> Any:
    """Compile sums whose terms may be added in any order, so several at once."""
    return njit(function, {"reassoc", "contract", "nsz"})


def has_avx2() -> bool:
    """Whether this processor is known to have AVX2, as those of x86-64 do since 2013, but for the smallest."""
    if sys.platform == "win32":
        return bool(ctypes.windll.kernel32.IsProcessorFeaturePresent(40))
    about = Path("/proc/cpuinfo")
    return about.exists() and " avx2 " in about.read_text()


def pinned_environment() -> dict[str, str]:
    """Environment variables, set before the libraries are imported, under which results are the same to the last bit.

    CMA-ES is chaotic, so its runs show the last bit. On x86-64 they are the same on every processor with AVX2.
    """
    if not has_avx2():
        return {"OPENBLAS_NUM_THREADS": "1", "NUMBA_CPU_NAME": "generic"}
    return {
        "OPENBLAS_NUM_THREADS": "1",
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": "+sse,+sse2,+sse3,+ssse3,+sse4.1,+sse4.2,+popcnt,+avx,+avx2,+fma,+bmi,+bmi2,+lzcnt",
    }
