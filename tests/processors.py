"""Machine code that OpenBLAS, numba and NumPy use in this process, and kernels that this processor can run."""

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import scipy
from llvmlite.binding import get_host_cpu_features

# Instructions that a kernel needs; a processor without them cannot run it.
KERNEL_NEEDS = {"SkylakeX": "avx512bw", "Haswell": "avx2", "Zen": "avx2", "Prescott": "sse3"}
# What OpenBLAS calls a kernel where another name stands for it: builds without Zen's own kernel use Haswell's for it,
# and the first name of the kernel for processors without AVX is Katmai.
ALIASES = {"Zen": "Haswell", "Prescott": "Katmai"}


def kernels_here() -> list[str]:
    """OpenBLAS kernels that this processor can run."""
    features = get_host_cpu_features()
    return [kernel for kernel, needed in KERNEL_NEEDS.items() if features.get(needed)]


def printed(code: str, **settings: str) -> str:
    """What a process prints that runs some code under other settings."""
    command = [sys.executable, "-W", "ignore", "-c", code]
    return subprocess.run(
        command, env=os.environ | settings, capture_output=True, text=True, check=True
    ).stdout.strip()


def openblas_kernels() -> set[str]:
    """Kernels of the OpenBLAS libraries that NumPy and SciPy bring."""
    kernels = set()
    for package in (np, scipy):
        for path in (Path(package.__file__).parents[1] / f"{package.__name__}.libs").glob(
            "*openblas*"
        ):
            library = ctypes.CDLL(str(path))
            for name in ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename"):
                if hasattr(library, name):
                    corename = getattr(library, name)
                    corename.restype = ctypes.c_char_p
                    kernels.add(corename().decode())
    return kernels


def numba_target() -> str:
    """Name of the processor that numba compiles for."""
    from numba.core.registry import cpu_target

    return cpu_target.target_context.codegen().magic_tuple()[1]


def numpy_simd() -> list[str]:
    """Groups of SIMD instructions beyond every x86-64's that NumPy uses."""
    return list(np.show_config(mode="dicts")["SIMD Extensions"].get("found", []))
