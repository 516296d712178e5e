import subprocess
import sys

import pytest

from workbook import ROOT


@pytest.mark.parametrize(
    ("code", "kept_out"),
    [
        ("from backlash import main", ("numpy", "studies", "workbook")),
        (
            "import backlash.commands",
            (
                *("cma", "joblib", "matplotlib", "pooch", "scipy.interpolate", "scipy.optimize"),
                *("scipy.signal", "scipy.stats", "studies", "tqdm", "workbook"),
            ),
        ),
    ],
)
def test_a_command_imports_nothing_that_it_does_not_use(code, kept_out):
    code = f"import sys; {code}; print(*sys.modules, sep='\\n')"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout
    assert not set(loaded.splitlines()) & set(kept_out)
