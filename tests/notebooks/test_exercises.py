"""Each exercise has a check, which in a lab copy tells right answers, honest roundings and near misses."""

import re

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
    "09": {"benches": 2, "repeats": 2, "robots_each": 2, "couplings": [0.03]},
    "12": {"benches": 1, "levels": [6], "realisations": [1]},
    "14": {"noises": 2, "bits": [19], "frictions": [0.05]},
}


@pytest.mark.parametrize("name", SOURCES)
def test_each_of_three_exercises_says_how_precisely_it_asks_and_is_followed_by_its_check(name):
    cells = jupytext.read(SOURCES[name]).cells
    tags = [cell.metadata.get("tags", []) for cell in cells]
    solutions = [position for position, each in enumerate(tags) if "solution" in each]
    assert len(solutions) == 3
    for position in solutions:
        assert "check" in tags[position + 1]
        check = cells[position + 1].source
        answer = re.search(r"check_answer\(\s*(\w+),", check)[1]
        text = " ".join(cells[position - 1].source.split())
        asked = re.search(rf"\(`{answer}`([^)]*)\)", text)[1]
        precision = re.search(r"\bto=([\d.]+)", check)
        words = f"to {precision[1]}" if precision else "a whole number"
        assert words in asked, (answer, asked)


def assert_checks_tell(exercises):
    for each in exercises:
        assert each.blank == "", each.name
        assert each.of_solution == "right", each.name
        assert set(each.of_roundings) == {"right"}, (each.name, each.of_roundings)
        assert set(each.of_misses) == {"not yet"}, (each.name, each.of_misses)
        assert each.of_word == "not yet: 'one' is not a number"


@pytest.mark.slow
@pytest.mark.parametrize("name", [name[:2] for name in SOURCES if not name.startswith("15")])
def test_a_check_tells_the_solution_and_its_roundings_from_near_misses(answer_exercises, name):
    assert_checks_tell(answer_exercises(name, **FASTER.get(name, {})))


@pytest.mark.slow
def test_a_check_tells_answers_on_logs_of_real_joints(answer_exercises, hardware_logs):
    assert_checks_tell(answer_exercises("15"))
