import os
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import settings

from replication import published
from replication.records import AUTHORS_FILES, add_noise, authors_file, constant_speed, load_clean
from replication.signature import Timing, h

# Fixtures of what is not in the project: the variable that names its folder, and why a test is skipped.
OUTSIDE = {
    "authors_data": ("BACKLASH_DATA", "needs the authors' files, in the folder BACKLASH_DATA"),
    "hardware_logs": ("HARDWARE_LOGS", "needs logs of real joints, in the folder HARDWARE_LOGS"),
    "paper": ("PAPER_TEXT", "needs the paper as text, in the folder PAPER_TEXT"),
}
NOWHERE = f"{os.devnull}/authors-data"
# A test that does not say that it needs the authors' files finds none, not even in a download cache.
os.environ["BACKLASH_DATA"] = os.environ.get("BACKLASH_DATA") or NOWHERE
# Parameters that a record is made with: its windows start midway between samples.
TRUE_X = np.array([-0.6, 0.0125, 15.0, 134.0, 100.0, 0.1515, 0.0125])

# Nor does a test read the user's configuration of Jupyter.
os.environ["JUPYTER_NO_CONFIG"] = "1"

# No test hangs on a clock: other machines are slower.
settings.register_profile("no clock", deadline=None)
settings.load_profile("no clock")

# Tests that run side by side leave no core free for processes of their own.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("LOKY_MAX_CPU_COUNT", "1")


# Nor does one use the network: sockets are blocked here, and these variables hold for processes that a test starts.
CLOSED = "http://127.0.0.1:9"
os.environ |= dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), CLOSED)
os.environ |= {"no_proxy": "127.0.0.1,localhost", "NO_PROXY": "127.0.0.1,localhost"}


# Where a library's machine code for another processor could change a result.
PORTABLE = (
    "tests/test_portable.py",
    *(f"tests/replication/test_{name}.py" for name in ("signature", "misfit", "cmaes", "table2")),
    *(f"tests/replication/test_{name}.py" for name in ("characteristic", "joint")),
)


@pytest.fixture
def replace_table(monkeypatch):
    """Give a data file other rows."""
    kept = published.table

    def give(name, table):
        monkeypatch.setattr(
            published, "table", lambda asked: table.copy() if asked == name else kept(asked)
        )

    return give


def pytest_collection_modifyitems(items):
    """Mark tests that another processor could fail (`make portable` runs them), and those that need data."""
    for item in items:
        if item.nodeid.startswith(PORTABLE):
            item.add_marker("portable")
        for fixture in OUTSIDE.keys() & item.fixturenames:
            variable, reason = OUTSIDE[fixture]
            item.add_marker("data")
            if os.environ.get(variable, NOWHERE) == NOWHERE:
                item.add_marker(pytest.mark.skip(reason=reason))


@pytest.fixture(scope="session")
def authors_data():
    """Verify the authors' files; a test that needs them is marked `data`, and skipped without them."""
    for path in AUTHORS_FILES:
        authors_file(path)


@pytest.fixture
def hardware_logs():
    """Logs of real joints, which are verified as they are read; a test without them is skipped."""


def signature_record(X=TRUE_X, noise_rps=0.05, seed=1):
    """A record of the paper's signature and noise."""
    base = constant_speed()
    made = replace(base, v=base.v + h(base.t, X, Timing()))
    return add_noise(made, noise_rps, np.random.default_rng(seed))


@pytest.fixture(scope="session")
def made_record():
    return signature_record(seed=5)


@pytest.fixture(scope="session")
def record_12(authors_data):
    """The authors' clean record 12, which their stored runs were fitted to."""
    return load_clean(12)
