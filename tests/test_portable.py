"""What must hold under any x86-64 processor's settings; `make portable` and the GitHub workflow set them."""

import os
import re

import pytest
from llvmlite import binding as llvm

from replication.processors import pinned_environment
from tests.processors import ALIASES, numba_target, numpy_simd, openblas_kernels

KERNEL = os.environ.get("OPENBLAS_CORETYPE")
needs_settings = pytest.mark.skipif(
    not KERNEL, reason="this processor's own settings; `make portable` sets others"
)


@pytest.mark.parametrize("triple", ["aarch64-unknown-linux-gnu", "arm64-apple-darwin"])
def test_on_arm64_a_product_is_computed_in_registers(triple):
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    product = "define double @f(double %a, double %b) { %c = fmul double %a, %b ret double %c }"
    settings = pinned_environment("arm64")
    assert "NUMBA_CPU_FEATURES" not in settings
    target = llvm.Target.from_triple(triple).create_target_machine(settings["NUMBA_CPU_NAME"])
    code = target.emit_assembly(llvm.parse_assembly(product))
    assert "fmul" in code
    assert "__muldf3" not in code


@needs_settings
def test_the_settings_that_the_environment_asks_for_are_in_effect():
    assert openblas_kernels() <= {KERNEL, ALIASES.get(KERNEL)}
    if "NUMBA_CPU_NAME" in os.environ:
        assert numba_target() == os.environ["NUMBA_CPU_NAME"]
    disabled = set(re.split("[ ,]", os.environ.get("NPY_DISABLE_CPU_FEATURES", "")))
    assert not disabled & set(numpy_simd())
