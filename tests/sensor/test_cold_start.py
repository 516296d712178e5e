import subprocess
import sys
import tomllib

import pytest

import backlash
from workbook import ROOT


@pytest.mark.parametrize(
    ("code", "kept_out"),
    [
        ("from backlash import main", ("numpy", "studies", "workbook")),
        ("import backlash.commands", ("cma", "matplotlib", "pooch", "scipy.signal", "scipy.stats")),
        ("import backlash.commands", ("studies", "workbook")),
    ],
)
def test_a_command_imports_nothing_that_it_does_not_use(code, kept_out):
    code = f"import sys; {code}; print(*sys.modules, sep='\\n')"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout
    assert not set(loaded.splitlines()) & set(kept_out)


def test_the_public_names_are_these_and_each_is_there():
    assert sorted(backlash.__all__) == [
        "Calibration", "Estimate", "Log", "Trend", "UnusableLog", "calibrate", "estimate", "estimate_many",
        "read_log", "trend", "trend_many",
    ]  # fmt: skip
    assert all(getattr(backlash, name).__doc__ for name in backlash.__all__)


def test_the_version_is_the_projects():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert backlash.__version__ == project["version"]
