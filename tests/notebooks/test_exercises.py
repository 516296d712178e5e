"""Each exercise has a check, which in a lab copy says *not yet* until the answer is right."""

import jupytext
import pytest

from workbook.outcomes import notebook_sources

SOURCES = notebook_sources()
# Parameters with which a notebook runs faster; the checks hold for any.
FASTER = {
    "00": {"runs": 1},
    "03": {"alphas": [1e5], "start_factor": 1.0},
    "05": {"seeds": 2},
    "07": {"seeds": [1]},
    "08": {"public": [1], "runs_each": 2},
    "09": {"benches": 2, "repeats": 2},
    "10": {"robots_each": 2, "couplings": [0.03], "torque_shares": [0.1], "repeats": 2},
    "12": {"benches": 1, "levels": [6], "realisations": [1]},
    "14": {"noises": 2, "noise_seeds": 2, "mountings": 1, "bits": [19], "frictions": [0.05]},
}


@pytest.mark.parametrize("name", SOURCES)
def test_each_solution_is_followed_by_its_check(name):
    code = [cell for cell in jupytext.read(SOURCES[name]).cells if cell.cell_type == "code"]
    tags = [cell.metadata.get("tags", []) for cell in code]
    at = [position for position, each in enumerate(tags) if "solution" in each]
    assert [position for position, each in enumerate(tags) if "check" in each] == [
        position + 1 for position in at
    ]


def assert_checks_tell(said):
    assert said == [["not yet", "right", "not yet", "not yet: 'one' is not a number"]] * 3


@pytest.mark.slow
@pytest.mark.parametrize("name", [name[:2] for name in SOURCES if not name.startswith("15")])
def test_a_check_tells_no_answer_the_solution_and_a_wrong_answer(answer_exercises, name):
    assert_checks_tell(answer_exercises(name, **FASTER.get(name, {})))


@pytest.mark.slow
def test_a_check_tells_answers_on_logs_of_real_joints(answer_exercises, hardware_logs):
    assert_checks_tell(answer_exercises("15"))
