"""A reproducible workbook of "A virtual sensor for backlash in robotic manipulators": the paper."""

import platform
from collections.abc import Callable
from typing import Any


def njit(function: Callable) -> Any:
    """Compile a function; its machine code is kept where a folder for it can be written."""
    import numba  # slow, and not every command computes

    try:
        return numba.njit(cache=True, nogil=True)(function)
    except RuntimeError:  # no folder for the cache
        return numba.njit(nogil=True)(function)


def pinned_environment(machine: str = platform.machine()) -> dict[str, str]:
    """Environment variables, set before the libraries are imported, under which results are the same to the last bit.

    CMA-ES is chaotic, so its runs show the last bit. On x86-64 they are the same on every processor with AVX2.
    """
    if machine not in ("x86_64", "AMD64"):
        return {"OPENBLAS_NUM_THREADS": "1", "NUMBA_CPU_NAME": "generic"}
    return {
        "OPENBLAS_NUM_THREADS": "1",
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": "+sse,+sse2,+sse3,+ssse3,+sse4.1,+sse4.2,+popcnt,+avx,+avx2,+fma,+bmi,+bmi2,+lzcnt",
    }
