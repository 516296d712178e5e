import os

import pytest
from hypothesis import settings

from replication import datasets
from replication.data.authors import WORKBOOK_FILES, DataUnavailable, authors_file

# No test hangs on a clock: other machines are slower.
settings.register_profile("no clock", deadline=None)
settings.load_profile("no clock")

# Tests that run side by side leave no core free for processes of their own.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("LOKY_MAX_CPU_COUNT", "1")


@pytest.fixture(scope="session")
def authors_data():
    """Skip a test where the authors' data are neither at hand nor to be downloaded."""
    try:
        for path in WORKBOOK_FILES:
            authors_file(path)
    except DataUnavailable as error:
        pytest.skip(f"needs the authors' data: {error}")


@pytest.fixture(scope="session")
def record_12(authors_data):
    """The authors' clean record 12, which their stored runs were fitted to."""
    return datasets.load_clean(12)
