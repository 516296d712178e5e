"""Changes of parameters in notebooks 0 to 5, natural and foolish ones: what the verdict then says."""

import re

import pytest

from workbook import ParameterError

pytestmark = pytest.mark.slow


def test_without_noise_the_signature_itself_makes_most_of_the_error(run_notebook):
    *_, printed = run_notebook("00", runs=2)
    own, noise = (float(x) for x in re.findall(r"([+-]\d+\.\d) %", printed)[:2])
    assert -8 < own < -5
    assert abs(noise) < 3.5  # A is free by as much


def test_a_small_population_misses_the_lowest_misfit_more_often_and_the_verdict_says_so(
    run_notebook,
):
    names, few, _ = run_notebook("00", population=10, runs=5)
    assert f"{names['reached']} of the 5 single searches" in few
    assert names["reached"] < 5
    assert names["best"].rmse <= min(each.rmse for each in names["fits"]) + 1e-4


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("00", {"seed": 1.5}),
        ("00", {"turn_period_s": 0.4013}),
        ("01", {"changes": {"G/J_l": 0.0}}),
        ("03", {"changes": {"G/J_l": 0.0}}),
        ("03", {"changes": {"K_p": 50.0}}),
        ("03", {"changes": {"Omega": 0.0}}),
        ("04", {"changes": {"N": 0.0}}),
        ("04", {"changes": {"J_m": 0.0}}),
        ("04", {"changes": {"G": 0.0}}),
        ("05", {"cost": lambda residual: 0.0}),
        ("05", {"cost": lambda one, two, three, four: one}),
        ("05", {"cost": lambda residual: None}),
        ("05", {"cost": max}),
        ("05", {"more_bounds": {"beat": (1.0,)}}),
        ("05", {"more_bounds": [(1.0, 2.0)]}),
        ("05", {"more_bounds": 5}),
    ],
)
def test_a_natural_mistake_ends_in_one_line_that_names_the_parameter(
    run_notebook, name, parameters
):
    with pytest.raises(ParameterError) as refusal:
        run_notebook(name, **parameters)
    assert str(refusal.value).startswith(next(iter(parameters)))
    assert len(refusal.value._render_traceback_()) == 1


def test_a_stiffness_ten_times_as_high_rings_or_is_refused(run_notebook):
    try:
        _, verdict, _ = run_notebook("01", changes={"K_s/J_l": 10.0})
    except ParameterError:
        return
    assert "nan" not in verdict


def test_a_joint_with_another_gear_is_not_compared_and_no_number_is_given(run_notebook):
    names, verdict, _ = run_notebook("03", changes={"N": 2.0}, alphas=[1e5], start_factor=1.0)
    assert "is not compared with the records" in verdict
    assert "nan" not in verdict
    assert "table2.row01.theoretical" not in names["cells"]


def test_a_parameter_that_the_signature_does_not_use_changes_nothing(run_notebook):
    _, verdict, _ = run_notebook("05", more_bounds={"beat": (0.0, 1.0)})
    times = float(re.search(r"(\d\.\d\d) times as much", verdict).group(1))
    assert times == pytest.approx(1, abs=0.01) or "one search alone" in verdict


def test_another_cost_leaves_the_counts_of_the_stored_runs_as_they_are(run_notebook):
    names, verdict, _ = run_notebook("05", cost="L1", seeds=2)
    assert names["cells"].get("text.turns") == (12 if names["reproduced"][12] else None)
    assert "times as much" in verdict
