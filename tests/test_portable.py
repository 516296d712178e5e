"""Settings of other processors, which `make test KERNEL=...` and the weekly workflow make, are in effect."""

import ctypes
import os
from pathlib import Path

import numpy as np
import pytest
import scipy
from numba.core.registry import cpu_target

KERNEL = os.environ.get("OPENBLAS_CORETYPE")
# What OpenBLAS calls a kernel where another name stands for it: builds without Zen's own kernel use Haswell's for it,
# and the first name of the kernel for processors without AVX is Katmai.
ALIASES = {"Zen": "Haswell", "Prescott": "Katmai"}


def openblas_kernels() -> set[str]:
    """Kernels of the OpenBLAS libraries that NumPy and SciPy bring."""
    kernels = set()
    for package in (np, scipy):
        libraries = Path(package.__file__).parents[1] / f"{package.__name__}.libs"
        for path in libraries.glob("*openblas*"):
            library = ctypes.CDLL(str(path))
            for name in ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename"):
                if hasattr(library, name):
                    corename = getattr(library, name)
                    corename.restype = ctypes.c_char_p
                    kernels.add(corename().decode())
    return kernels


@pytest.mark.skipif(
    not KERNEL, reason="this processor's own settings; make test KERNEL=... sets others"
)
def test_the_settings_that_the_environment_asks_for_are_in_effect():
    assert openblas_kernels() <= {KERNEL, ALIASES.get(KERNEL)}
    if target := os.environ.get("NUMBA_CPU_NAME"):
        assert cpu_target.target_context.codegen().magic_tuple()[1] == target
    disabled = os.environ.get("NPY_DISABLE_CPU_FEATURES", "").replace(",", " ").split()
    in_use = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    assert not set(disabled) & set(in_use)
