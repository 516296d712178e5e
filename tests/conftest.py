import os
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import settings

from replication.authors import WORKBOOK_FILES, DataUnavailable, authors_file, load_clean
from replication.recording import add_uniform_noise, constant_speed
from replication.signature import Timing, signature

NEEDED = "needs the authors' data"
# Parameters that a record is made with.
TRUE_X = np.array([-0.6, 0.012, 15.0, 134.0, 100.0, 0.1507, 0.0113])

# No test hangs on a clock: other machines are slower.
settings.register_profile("no clock", deadline=None)
settings.load_profile("no clock")

# Tests that run side by side leave no core free for processes of their own.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("LOKY_MAX_CPU_COUNT", "1")


# Tests of files and processes, and of notebooks, whose kernels are pinned: they say nothing of other processors.
NOT_PORTABLE = (
    "tests/workbook/",
    "tests/report/",
    "tests/sensor/test_fleet.py",
    "tests/test_try_changing.py",
)


def pytest_collection_modifyitems(items):
    """Mark the tests that compute: `make portable` runs them as on other processors."""
    for item in items:
        if not item.nodeid.startswith(NOT_PORTABLE):
            item.add_marker("portable")


def pytest_terminal_summary(terminalreporter):
    """Say how the tests that were skipped without the authors' data can be run."""
    skipped = terminalreporter.stats.get("skipped", [])
    if missing := [report for report in skipped if NEEDED in str(report.longrepr)]:
        terminalreporter.write_line(
            f"{len(missing)} tests were skipped without the authors' data: `make data` fetches them"
        )


@pytest.fixture(scope="session")
def authors_data():
    """Skip a test where the authors' data are neither at hand nor to be downloaded."""
    try:
        for path in WORKBOOK_FILES:
            authors_file(path)
    except DataUnavailable as error:
        pytest.skip(f"{NEEDED}: {error}")


@pytest.fixture(scope="session")
def made_record():
    """A record of the signature of `TRUE_X` and noise."""
    base = constant_speed(samples=2401, dt=0.002)
    made = replace(base, v=base.v + signature(base.t, TRUE_X, Timing(0.2, 0.4, 12)))
    return add_uniform_noise(made, 0.05, np.random.default_rng(5))


@pytest.fixture(scope="session")
def record_12(authors_data):
    """The authors' clean record 12, which their stored runs were fitted to."""
    return load_clean(12)
