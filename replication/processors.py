"""Settings under which the libraries compute the same on every processor of a kind."""

# The same machine code on every x86-64 processor with AVX2, as far as libraries let themselves be pinned: CMA-ES
# is chaotic in the last bit.
_PINNED = {
    "OPENBLAS_CORETYPE": "Haswell",
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "+sse,+sse2,+sse3,+ssse3,+sse4.1,+sse4.2,+popcnt,+avx,+avx2,+fma,+bmi,+bmi2,+lzcnt",
    "PYTHONHASHSEED": "0",
    "PYTHONWARNINGS": "ignore:IProgress not found",
    "MPLBACKEND": "module://matplotlib_inline.backend_inline",
}


def pinned_environment() -> dict[str, str]:
    """Environment variables under which notebooks and studies compute; they act before the libraries are imported."""
    return dict(_PINNED)
