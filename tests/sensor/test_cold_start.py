import subprocess
import sys
import tomllib

import numpy as np
import pytest
from scipy import signal

import backlash
from backlash.fitting import harmonics
from backlash.reading.low_pass import low_pass
from replication.workbook import ROOT


@pytest.mark.parametrize(
    ("code", "kept_out"),
    [
        ("from backlash import main", ("numpy", "backlash.studies", "replication.report")),
        (
            "import backlash.commands",
            ("cma", "matplotlib", "pooch", "scipy.signal", "scipy.stats"),
        ),
        ("import backlash.commands", ("backlash.studies", "replication.report", "replication.workbook")),
    ],
)
def test_a_command_imports_nothing_that_it_does_not_use(code, kept_out):
    code = f"import sys; {code}; print(*sys.modules, sep='\\n')"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert not set(loaded.splitlines()) & set(kept_out)


def test_what_is_written_out_to_save_an_import_is_what_scipy_computes():
    v, turns, last = np.random.default_rng(1).normal(size=2401), 11, 90
    filtered = signal.sosfiltfilt(signal.butter(6, 78.0, output="sos", fs=500.0), v)
    np.testing.assert_allclose(low_pass(v, 78.0, 2e-3), filtered, rtol=1e-9, atol=1e-12)
    bins = signal.czt(v, (last + 1) * turns, np.exp(-2j * np.pi / 2200.5)) / v.size
    np.testing.assert_allclose(harmonics._spectrum(v, turns, last, 2200.5)[0], bins, rtol=1e-9, atol=1e-12)


def test_the_public_names_are_these_and_each_is_there():
    assert sorted(backlash.__all__) == [
        "Calibration", "Estimate", "Log", "Trend", "UnusableLog", "calibrate", "estimate", "read_log", "trend"
    ]  # fmt: skip
    assert all(getattr(backlash, name).__doc__ for name in backlash.__all__)


def test_the_version_is_the_projects():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert backlash.__version__ == project["version"]
