"""Changes of parameters in notebooks 6 to 8, natural and foolish ones: what the verdict then says."""

import pytest

from workbook import ParameterError

pytestmark = pytest.mark.slow


def test_a_search_that_fails_is_said_to_fail_before_its_amplitude_is(run_notebook):
    _, text, _ = run_notebook("07", population=4, iterations=10, seeds=[1])
    assert text.startswith("In this run no run of CMA-ES finds the global minimum")
    assert "; runs stopped by the limit of 10 generations: 1" in text


def test_with_four_members_no_minimum_is_found_and_the_amplitude_says_nothing(run_notebook):
    _, text, _ = run_notebook("07", population=4, seeds=[1, 2])
    assert text.startswith("In this run no run of CMA-ES finds the global minimum")
    assert "so its |A| says nothing" in text


def test_a_wider_box_is_not_judged_by_the_lowest_misfit_of_the_authors_box(run_notebook):
    names, text, _ = run_notebook("07", box={"T2": (0.0, 0.4)}, seeds=[1, 2, 3])
    lower = names["runs"]["over the global minimum"].min() < 0.99
    assert ("the box is not the authors'" in text) == lower


def test_an_optimiser_of_ones_own_is_judged_by_the_same_minimum(run_notebook):
    def middle(misfits, box, seed):
        return (box.lower + box.upper) / 2

    _, text, _ = run_notebook("07", optimiser=middle, seeds=[1])
    assert text.startswith("In this run no run of your optimiser finds the global minimum")


def test_with_four_members_no_mean_of_table_2_is_said_to_be_this_runs(run_notebook):
    _, text, _ = run_notebook("08", population=4, runs_each=2, public=[1])
    assert text.startswith("In this run 0 % of 20 searches with a population of 4")
    assert "On 10 of 10 records no run finds it" in text
    assert "Read from the kept realisations, not from this run:" in text


def test_with_thirty_members_the_records_that_no_run_solves_are_counted(run_notebook):
    names, text, _ = run_notebook("08", population=30, runs_each=3, public=[1])
    solved = names["fits"].groupby("row")["at_minimum"].any()
    assert (f"On {10 - solved.sum()} of 10 records no run finds it" in text) == (not solved.all())
    assert f"In this run {100 * names['fits']['at_minimum'].mean():.0f} % of 30 searches" in text


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        ("06", {"left_out": [1, 2, 3, 4, 5, 6]}, "rows in left_out = 6"),
        ("06", {"changes": {"K_s/J_l": 10}}, "changes['K_s/J_l'] = 10"),
        ("07", {"population": 3}, "population = 3"),
        ("07", {"box": {"t0": (0.1,)}}, "box = {'t0': (0.1,)}"),
        ("07", {"box": {"t0": (0.2, 0.1)}}, "box = {'t0': (0.2, 0.1)}"),
        ("07", {"optimiser": lambda one, two, three, four: one}, "optimiser = '<lambda>'"),
        (
            "07",
            {"optimiser": lambda misfits, box, seed: None, "seeds": [1]},
            "optimiser = '<lambda>'",
        ),
        ("07", {"optimiser": max}, "optimiser = 'max'"),
        ("09", {"measure_mrad": 0.5}, "measure_mrad = 0.5"),
        ("08", {"public": [6]}, "public[0] = 6"),
        ("08", {"runs_each": 1}, "runs_each = 1"),
    ],
)
def test_a_natural_mistake_ends_in_one_line(run_notebook, name, parameters, words):
    with pytest.raises(ParameterError) as refusal:
        run_notebook(name, **parameters)
    assert str(refusal.value).startswith(words)
    assert "\n" not in str(refusal.value)
