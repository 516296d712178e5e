"""Changes of parameters in notebooks 11, 12 and 15: what the verdict then says."""

import pytest

from workbook import ParameterError

pytestmark = pytest.mark.slow


def test_friction_above_gravity_is_refused_and_the_verdict_says_so(run_notebook):
    names, verdict, _ = run_notebook("11", friction_share=1.2, log_turns=8)
    assert names["by_torque"].backlash_rad is None
    assert "by the torque: no answer (no load reversal seen)" in verdict


def test_at_much_friction_the_verdict_gives_no_number_that_the_sensor_refuses(run_notebook):
    names, verdict, _ = run_notebook("11", friction_share=0.9)
    refused = names["by_torque"].backlash_rad is None
    assert ("by the torque: no answer" in verdict) == refused
    refused = names["calibrated"].backlash_rad is None
    assert ("with its own calibration: no answer" in verdict) == refused


def test_a_drive_that_the_fit_does_not_know_gives_no_backlash(run_notebook):
    names, verdict, _ = run_notebook("12", gain_factor=0.7, benches=1, levels=[6], realisations=[1])
    assert names["chance"] < 1e-3
    assert verdict.startswith("No joint with the paper's drive fits the log")
    assert "interval" not in verdict


def test_a_fitted_joint_errs_less_than_equation_10_on_the_records_of_this_run(run_notebook):
    names, verdict, _ = run_notebook("12", benches=1, levels=[5, 8], realisations=[1])
    mean = names["summary"]["mean error"]
    assert mean["joint known"] < mean["equation 10"]
    assert "On noisy logs (2 of them)" in verdict


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("11", {"backlash_mrad": -1.0}),
        ("11", {"my_log": "no such file.csv"}),
        ("11", {"calibration_levels": 4}),
        ("12", {"gain_factor": 10}),
        ("12", {"levels": [20]}),
        ("12", {"levels": 5}),
        ("14", {"turns": [12]}),
        ("14", {"frictions": []}),
        ("14", {"mountings": 1.5}),
    ],
)
def test_a_natural_mistake_ends_in_one_line_that_names_the_parameter(
    run_notebook, name, parameters
):
    with pytest.raises(ParameterError) as refusal:
        run_notebook(name, **parameters)
    assert next(iter(parameters)) in str(refusal.value).partition(" = ")[0]
    assert "\n" not in str(refusal.value)
