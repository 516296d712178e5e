"""Changes of parameters, natural and foolish ones: what the verdict then says."""

import re
from types import SimpleNamespace

import pytest

from workbook import ParameterError

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("on_simulated_records")]


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("00", {"turn_period_s": 0.4013}),
        ("01", {"changes": {"K_s/J_l": 10.0, "G/J_l": 3.0}}),
        ("01", {"changes": {"G/J_l": 0.05}}),
        ("03", {"changes": {"K_p": 50.0}}),
        ("04", {"changes": {"N": 0.0}}),
        ("05", {"cost": max}),
        ("05", {"more_bounds": {"beat": (1.0,)}}),
        ("05", {"more_bounds": {"A": (0.0, 1.0)}}),
        ("06", {"left_out": [1, 2, 3, 4, 5, 6]}),
        ("07", {"box": {"t0": (0.2, 0.1)}}),
        ("07", {"optimiser": lambda misfits, box, seed: None, "seeds": [1]}),
        ("08", {"runs_each": 1}),
        ("09", {"measure_mrad": 0.5}),
        ("09", {"shaking": 1.0}),
        ("11", {"my_log": "no such file.csv"}),
        ("12", {"gain_factor": 10}),
        ("14", {"bits": [5]}),
    ],
)
def test_a_natural_mistake_ends_in_one_line_that_names_the_parameter(
    run_notebook, name, parameters
):
    with pytest.raises(ParameterError) as refusal:
        run_notebook(name, parameters)
    (line,) = refusal.value._render_traceback_()
    assert next(iter(parameters)) in line.partition(" = ")[0]
    assert "\n" not in line


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("00", {"backlash_mrad": 0.0, "runs": 1}),
        ("00", {"noise_rps": 0.0, "runs": 1}),
        ("00", {"backlash_mrad": 2.1, "friction_share": 0.5, "populations": [10], "runs": 1}),
        ("01", {"alphas": [1.0], "backlash_mrad": 0.1}),
        ("03", {"changes": {"N": 2.0}, "alphas": [1e12], "start_factor": 1.0}),
        ("04", {"changes": {"G/J_l": 0.01}, "noise_rps": 10}),
        ("05", {"turns": 1, "seeds": 2}),
        ("06", {"left_out": [1, 2, 3, 4, 5], "degree": 6}),
        ("07", {"population": 4, "iterations": 1, "seeds": [1]}),
        ("08", {"public": [1], "runs_each": 2, "population": 4}),
        ("08", {"public": [1, 1], "runs_each": 2, "shown_row": 10}),
        (
            "09",
            {
                "couplings": [0.0],
                "spread": {"ratios": 0.0},
                "benches": 2,
                "robots_each": 2,
                "repeats": 2,
            },
        ),
        ("11", {"backlash_mrad": 0.0, "log_turns": 4}),
        ("12", {"benches": 1, "levels": [6, 6], "realisations": [1, 1]}),
    ],
)
def test_no_sentence_has_a_number_that_is_none_or_the_wrong_number_of_a_noun(
    run_notebook, name, parameters
):
    run = run_notebook(name, parameters)
    sentences = " ".join(run.said + run.verdicts)
    assert not re.search(r"\b(nan|inf|None)\b", sentences)
    assert not re.search(
        r"\b1 (runs|turns|values|logs|records|searches|generations|joints)\b", sentences
    )
    assert not re.search(r"(?<![\d.])([\d.]+) to \1(?![\d.]) ", sentences)


def test_one_joint_is_not_called_joints(run_notebook, hardware_logs):
    run = run_notebook("15", {"makes": ["T-Motor"]})
    assert run.verdicts[0].startswith("Of 4 logs (joints: 1) the sensor answers 0 ")
    assert run.said[-1] == "No joint of these logs has a second encoder."


def take_middle(misfits, box, seed):
    """A search that fails."""
    return (box.lower + box.upper) / 2


WATCHED = {"seeds": [3], "iterations": 3}
# Before its amplitude is named.
FAILED = "^In this run no run of (CMA-ES|your optimiser)[^.]* finds the lowest RMSE.*"


@pytest.mark.parametrize(
    ("name", "parameters", "code", "says"),
    [
        ("00", {"runs": 1}, "np.sin(X. → np.cos(X.", "as printed, not the code above"),
        ("00", {"backlash_mrad": 0.05, "runs": 3}, "", "No: with 60 points"),
        # Gravity alone does not turn before the teeth meet, and the shape of the ring is named later.
        (
            "00",
            {"friction_share": 0.5, "runs": 1},
            "",
            "360° the bottom: gravity with friction has to change its direction",
        ),
        (
            "00",
            {"backlash_mrad": 0.3, "friction_share": 0.05, "runs": 1},
            "",
            "^The best signature leaves.* s apart, and not half a turn",
        ),
        (
            "00",
            {"runs": 1},
            "rng(seed).uniform(-noise_rps, noise_rps, → rng(seed).normal(0, noise_rps,",
            r"has the SD \(standard deviation\) 0\.10",
        ),
        ("01", {}, "held = u → held = 1.1 * u", "No, their equations differ"),
        ("03", {"alphas": [1e3], "start_factor": 1.0}, "", r"\$\\alpha\$ = none\. "),
        ("04", {"commanded_speed_rps": 300.0}, "", "does not grow everywhere"),
        ("07", {"seeds": [2, 2]}, "", "1 of 1 run of CMA-ES"),
        ("07", WATCHED, "population=12 → population=12", "The search goes into a wrong one"),
        ("07", WATCHED, "population=12 → population=300", "The search goes into the right one"),
        (
            "07",
            {"population": 4, "iterations": 10, "seeds": [1]},
            "",
            f"{FAILED}Stopped by the limit, `iterations` = 10: 1 of 1",
        ),
        ("07", {"population": 4, "seeds": [1]}, "", rf"{FAILED}so its \|A\| says nothing"),
        ("07", {"optimiser": take_middle, "seeds": [1]}, "", FAILED.replace("CMA-ES|", "")),
        ("08", {"public": [1], "runs_each": 2}, "0.4, 401 → 0.04, 401", "Minima in 40 ms: "),
        # No mean of Table 2 is said to be this run's.
        (
            "08",
            {"population": 4, "runs_each": 2, "public": [1]},
            "",
            "^In this run 0 % of 20 searches with a population of 4"
            r".* a mean of \$A\$ says nothing: 10 of 10\."
            ".*Read from the kept realisations, not from this run:",
        ),
    ],
)
def test_a_sentence_says_what_a_change_did(run_notebook, name, parameters, code, says):
    run = run_notebook(name, parameters, code)
    assert any(re.search(says, each, re.DOTALL) for each in run.said + run.verdicts), run.said
    assert not re.search(r"\b(nan|inf)\b", " ".join(run.said + run.verdicts))


def test_without_noise_the_signature_itself_makes_most_of_the_error(run_notebook):
    now = SimpleNamespace(**run_notebook("00", {"runs": 2}).names)
    quiet = now.Recording(now.t, now.clean, now.v_t, now.T_f, "without noise")
    own = now.off_percent(now.best_fit(quiet, now.settings[0]).amplitude_rps)
    assert -8 < own < -5
    assert abs(now.off_percent(now.A) - own) < 3.5  # A is free by as much


def test_a_small_population_misses_the_lowest_misfit_more_often_and_the_verdict_says_so(
    run_notebook,
):
    run = run_notebook("00", {"populations": [10], "runs": 5})
    reached = run.names["reached"][10]
    assert f"{reached} of 5 at the lowest misfit" in run.verdicts[0]
    assert reached < 5
    assert run.names["best"].rmse <= min(each.rmse for each in run.names["fits"][10]) + 1e-4


def test_a_joint_with_another_gear_is_not_compared_and_no_number_is_given(run_notebook):
    run = run_notebook("03", {"changes": {"N": 2.0}, "alphas": [1e5], "start_factor": 1.0})
    assert "is not compared with the records" in run.verdicts[0]
    assert "nan" not in run.verdicts[0]
    assert "table2.row01.theoretical" not in run.names["cells"]


def test_another_cost_leaves_the_counts_of_the_stored_runs_as_they_are(run_notebook):
    run = run_notebook("05", {"cost": "L1", "seeds": 2})
    turns = 12 if run.names["reproduced"][12] else None
    assert run.names["cells"].get("text.turns") == turns
    assert "times as much" in run.verdicts[0]


def test_a_wider_box_is_not_judged_by_the_lowest_misfit_of_the_authors_box(run_notebook):
    run = run_notebook("07", {"box": {"T2": (0.0, 0.4)}, "seeds": [1, 2, 3]})
    lower = run.names["runs"]["over the lowest"].min() < 0.99
    says = "the lowest RMSE in the authors' box: this box is another"
    assert (says in run.verdicts[0]) == lower


@pytest.mark.parametrize("friction_share", [0.9, 1.2])
def test_at_much_friction_the_verdict_gives_no_number_that_the_sensor_refuses(
    run_notebook, friction_share
):
    run = run_notebook("11", {"friction_share": friction_share})
    refused = run.names["by_torque"].backlash_rad is None
    assert friction_share < 1 or refused
    assert ("by the torque: no answer" in run.verdicts[0]) == refused


SHORT = {"benches": 1, "realisations": [1]}


def test_a_drive_that_the_fit_does_not_know_gives_no_backlash(run_notebook):
    run = run_notebook("12", {"gain_factor": 0.7, "levels": [6], **SHORT})
    assert run.names["chance"] < 1e-3
    assert run.verdicts[0].startswith("No joint with the paper's drive fits the log")
    assert "interval" not in run.verdicts[0]


def test_a_fitted_joint_errs_less_than_equation_10_on_the_records_of_this_run(run_notebook):
    run = run_notebook("12", {"levels": [5, 8], **SHORT})
    mean = run.names["summary"]["mean error"]
    assert mean["joint known"] < mean["equation 10"]
    assert "On noisy logs (2 of them)" in run.verdicts[0]
