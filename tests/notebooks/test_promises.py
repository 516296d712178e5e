"""What a notebook foretells of the changes to try happens, and does not happen without them."""

from types import SimpleNamespace

import pytest

from workbook.project import notebook_sources

pytestmark = pytest.mark.slow
NOTEBOOKS = [name for name in notebook_sources() if not name.startswith("15")]


def assert_kept(run, name):
    """Each of three changes does what its notebook says, and the unchanged notebook does not."""
    unchanged = run(name)
    was = SimpleNamespace(**unchanged.names)
    assert len(unchanged.promises) == 3
    for code, _, holds in unchanged.promises:
        assert not holds(was, was), f"foretold, and so without {code}"
        assert holds(SimpleNamespace(**run(name, code).names), was), code


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_each_change_does_what_the_notebook_says(name, run_notebook, authors_data):
    assert_kept(run_notebook, name)


def test_each_change_does_what_the_notebook_says_on_logs_of_real_joints(
    run_notebook, hardware_logs
):
    assert_kept(run_notebook, "15")
