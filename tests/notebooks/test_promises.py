"""What a notebook foretells of the changes to try happens, and does not happen without them."""

from types import SimpleNamespace

import pytest

from workbook.project import notebook_sources

pytestmark = pytest.mark.slow
NOTEBOOKS = [name for name in notebook_sources() if not name.startswith("15")]
# With fewer runs what is foretold is the same.
FASTER = {
    "00": {"runs": 15},
    "03": {"alphas": [1e5]},
    "05": {"seeds": 2},
    "08": {"public": [1], "runs_each": 10},
    "09": {"benches": 5, "repeats": 2, "robots_each": 8, "couplings": [0.03]},
    "12": {"benches": 1, "realisations": [1], "levels": [3, 7, 11]},
    "14": {"bits": [19]},
}


def assert_kept(run, name):
    """Each of three changes does what its notebook says, and the unchanged notebook does not."""
    faster = FASTER.get(name[:2], {})
    unchanged = run(name, faster)
    was = SimpleNamespace(**unchanged.names)
    assert len(unchanged.promises) == 3
    idle = [each.code for each in unchanged.promises if each.holds(was, was)]
    assert idle == [], "foretold, and so without the change"
    broken = []
    for change in unchanged.promises:
        now = SimpleNamespace(**run(name, faster, change.code).names)
        if not change.holds(now, was):
            broken.append(change.code)
    assert broken == []


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_each_change_does_what_the_notebook_says(name, run_to_promises, authors_data):
    assert_kept(run_to_promises, name)


def test_each_change_does_what_the_notebook_says_on_logs_of_real_joints(
    run_to_promises, hardware_logs
):
    assert_kept(run_to_promises, "15")
