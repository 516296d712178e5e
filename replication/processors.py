"""Settings under which the libraries compute the same on every processor of a kind."""

import platform

_EVERYWHERE = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "PYTHONHASHSEED": "0",
    "PYTHONWARNINGS": "ignore:IProgress not found",
    "MPLBACKEND": "module://matplotlib_inline.backend_inline",
}
# The same machine code on every x86-64 processor with AVX2, as far as libraries let themselves be
# pinned: CMA-ES is chaotic in the last bit. Elsewhere these names would make code that crashes.
_ON_X86_64 = {
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "+sse,+sse2,+sse3,+ssse3,+sse4.1,+sse4.2,+popcnt,+avx,+avx2,+fma,+bmi,+bmi2,+lzcnt",
}
_ELSEWHERE = {"NUMBA_CPU_NAME": "generic"}


def pinned_environment(machine: str = platform.machine()) -> dict[str, str]:
    """Environment variables under which notebooks and studies compute; they act before the libraries are imported."""
    return _EVERYWHERE | (_ON_X86_64 if machine in ("x86_64", "AMD64") else _ELSEWHERE)
