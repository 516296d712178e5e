import os
from unittest.mock import patch

import pytest

# Fixtures of what is not in the project: the variable that names its folder, and why a test is skipped.
OUTSIDE = {
    "authors_data": ("BACKLASH_DATA", "needs the authors' files, in the folder BACKLASH_DATA"),
    "hardware_logs": ("HARDWARE_LOGS", "needs logs of real joints, in the folder HARDWARE_LOGS"),
    "paper": ("PAPER_TEXT", "needs the paper as text, in the folder PAPER_TEXT"),
}
NOWHERE = f"{os.devnull}/authors-data"
# A test that does not say that it needs the authors' files finds none, not even in a download cache.
os.environ["BACKLASH_DATA"] = os.environ.get("BACKLASH_DATA") or NOWHERE

# Nor does a test read the user's configuration of Jupyter.
os.environ["JUPYTER_NO_CONFIG"] = "1"

# Tests run side by side: none starts processes of its own.
os.environ.setdefault("LOKY_MAX_CPU_COUNT", "1")

# Nor does one use the network: sockets are blocked here, and these variables hold for processes that a test starts.
CLOSED = "http://127.0.0.1:9"
os.environ |= dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), CLOSED)
os.environ |= {"no_proxy": "127.0.0.1,localhost", "NO_PROXY": "127.0.0.1,localhost"}


# What a library's machine code for another processor could change: searches, fits, integrals and compiled sums.
PORTABLE = (
    "tests/test_portable.py",
    "tests/replication/test_misfit.py",
    "tests/replication/test_cmaes.py::test_equations_13_to_17",
    "tests/replication/test_cmaes.py::test_members_are_drawn",
    "tests/replication/test_cmaes.py::test_the_search_finds",
    "tests/replication/test_best_fit.py::test_a_fit_finds",
    "tests/replication/test_best_fit.py::test_the_best_fit",
    "tests/studies/test_realisations.py::test_a_row_made_again",
    "tests/replication/test_joint.py::test_the_simulated_motion",
    "tests/replication/test_joint.py::test_the_teeth_meet",
    "tests/replication/test_joint.py::test_a_stiff_joint",
    "tests/studies/test_identification.py::test_the_ratios",
    "tests/studies/test_identification.py::test_where_errors_are_linear",
    "tests/studies/test_identification.py::test_its_settled_peaks",
    "tests/backlash/test_torque_load.py::test_the_orbit",
    "tests/backlash/test_torque_answer.py::test_the_answer_of_a_known",
    "tests/backlash/test_torque_answer.py::test_misfit_interval",
    "tests/backlash/test_strokes.py::test_under_other_kernels",
    "tests/backlash/test_turns.py::test_harmonics",
    "tests/backlash/test_turns.py::test_the_period",
)


def pytest_collection_modifyitems(items):
    """Mark tests that another processor could fail (`make test ONLY=portable` runs them), and those that need data."""
    for item in items:
        if item.nodeid.startswith(PORTABLE):
            item.add_marker("portable")
        for fixture in OUTSIDE.keys() & item.fixturenames:
            variable, reason = OUTSIDE[fixture]
            item.add_marker("data")
            if os.environ.get(variable, NOWHERE) == NOWHERE:
                item.add_marker(pytest.mark.skip(reason=reason))


@pytest.fixture(autouse=True)
def same_environment():
    """Commands set variables of their own process; no test leaves them to the next one."""
    with patch.dict(os.environ):
        yield


@pytest.fixture(scope="session")
def authors_data():
    """Verify the authors' files; a test that needs them is marked `data`, and skipped without them."""
    # Imported here: it is slow, and the process that hands out tests runs none.
    from replication.records import AUTHORS_FILES, authors_file

    for path in AUTHORS_FILES:
        authors_file(path)


@pytest.fixture
def hardware_logs():
    """Logs of real joints, which are verified as they are read; a test without them is skipped."""


@pytest.fixture(scope="session")
def record_12(authors_data):
    """The authors' clean record 12, which their stored runs were fitted to."""
    from replication.records import load_clean

    return load_clean(12)
