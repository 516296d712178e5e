"""Changes of parameters, natural and foolish ones: what the verdict then says."""

import re

import numpy as np
import pytest

from replication import cmaes
from workbook import ParameterError

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("on_simulated_records")]


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("00", "turn_period_s = 0.4013"),
        ("01", "changes = {'K_s/J_l': 10.0, 'G/J_l': 3.0}"),
        ("01", "changes = {'G/J_l': 0.05}"),
        ("03", "changes = {'K_p': 50.0}"),
        ("04", "changes = {'N': 0.0}"),
        ("05", "cost = max"),
        ("06", "left_out = [1, 2, 3, 4, 5, 6]"),
        ("07", "box = {'t0': (0.2, 0.1)}"),
        ("08", "runs_each = 1"),
        ("09", "measure_mrad = 0.5"),
        ("09", "shaking = 1.0"),
        ("11", "my_log = 'no such file.csv'"),
        ("12", "gain_factor = 10"),
        ("14", "bits = [5]"),
    ],
)
def test_a_natural_mistake_ends_in_one_line_that_names_the_parameter(run_notebook, name, change):
    with pytest.raises(ParameterError) as refusal:
        run_notebook(name, change)
    (line,) = refusal.value._render_traceback_()
    assert change.partition(" = ")[0] in line.partition(" = ")[0]
    assert "\n" not in line


def test_one_joint_is_not_called_joints(run_notebook, hardware_logs):
    run = run_notebook("15", "makes = ['T-Motor']")
    assert any(each.startswith("Of 4 logs (joints: 1) the sensor answers 0 ") for each in run.said)
    assert "No joint of these logs has a second encoder." in run.said


NEVER_SAID = (
    r"\b(nan|inf|None)\b",
    r"\b1 (runs|turns|values|logs|records|searches|generations|joints)\b",
    r"(?<![\d.])([\d.]+) to \1(?![\d.]) ",
)
# Before its amplitude is named.
FAILED = "^In this run no run finds the lowest RMSE.*"


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        # The shape of the ring is named later.
        (
            "00",
            "backlash_mrad = 0.3; friction_share = 0.05",
            "^The best signature leaves.* s apart, and not half a turn",
        ),
        ("00", "backlash_mrad = 0.0; noise_rps = 2.0", ""),
        ("00", "backlash_mrad = 0.05", "From ±0.1 rps on"),
        ("00", "backlash_mrad = 2.1; friction_share = 0.5", ""),
        ("00", "noise_rps = 0.0", ""),
        ("00", "(0.1, 0.2, 0.5, 1.0, 2.0) → (0.01, 0.02)", "At none of these"),
        ("00", "clean + noise, → clean + 2 * noise,", r"has the SD \(standard deviation\) 0\.11"),
        ("01", "alphas = [1.0]; backlash_mrad = 0.1", ""),
        ("03", "alphas = [1e3]; start_factor = 1.0", r"\$\\alpha\$ = none\. "),
        ("03", "changes = {'N': 2.0}; start_factor = 1.0", "is not compared with the records"),
        ("03", "changes = {'N': 2.0}; alphas = [1e12]; start_factor = 1.0", ""),
        ("04", "changes = {'G/J_l': 0.01}; noise_rps = 10", ""),
        ("04", "commanded_speed_rps = 300.0", "does not grow everywhere"),
        ("05", "sin(X.omega * since) → cos(X.omega * since)", r"by your code\. \(b\)"),
        # Without a transient, which only the first turn has.
        (
            "05",
            "load_clean(12) → load_clean(12)\n"
            "late = {'v': record.v + 3 * (record.t == 1.8)}\n"
            "record = type(record)(**(vars(record) | late))",
            r"largest at 1\.800 s\. After the first turn",
        ),
        ("05", "", "first turn begins with a transient"),
        # A cost that changes nothing.
        (
            "05",
            "cost = lambda residual: 2 * (residual**2).mean() ** 0.5",
            r"1\.00 times as much, with its \$\|A\|\$\.",
        ),
        ("05", "turns = 1", ""),
        ("06", "degree = 2", r"^It could in .*A\^3 \(-0\.0019 to -0\.0018\)"),
        ("06", "left_out = [1, 2, 3, 4, 5]; degree = 6", ""),
        ("07", "seeds = [2, 2]", "1 of 1 run ended"),
        ("07", "seeds = [1]; iterations = 3", "^It goes into a wrong one"),
        ("07", "seeds = [3]; iterations = 3", "^It goes into the right one"),
        ("07", "population = 4; iterations = 1; seeds = [1]", ""),
        (
            "07",
            "population = 4; iterations = 10; seeds = [1]",
            f"{FAILED}Stopped by the limit, `iterations` = 10: 1 of 1",
        ),
        ("07", "population = 4; seeds = [1]", rf"{FAILED}so its \|A\| says nothing"),
        ("07", "box = {'T2': (0.0, 0.4)}", "in the authors' box: this box is another"),
        ("08", "0.4, 401 → 0.04, 401", "Minima in 40 ms: "),
        # No mean of Table 2 is said to be this run's.
        (
            "08",
            "population = 4; runs_each = 2",
            "^In this run 0 % of 20 searches with a population of 4"
            r".* a mean of \$A\$ says nothing: 10 of 10\."
            ".*Read from the kept realisations, not from this run:",
        ),
        ("08", "public = [1, 1]; runs_each = 2; shown_row = 10", ""),
        (
            "09",
            "couplings = [0.0]; spread = {'ratios': 0.0}; benches = 2; robots_each = 2; repeats = 2",
            "",
        ),
        ("11", "backlash_mrad = 0.0; log_turns = 4", ""),
        ("11", "return low <= truth_mrad <= high → return False", "does not hold the true"),
        ("11", "friction_share = 1.2", "by the torque: no answer"),
        (
            "12",
            "gain_factor = 0.7; levels = [6]",
            "^No joint with the paper's drive fits the log(?!.*interval)",
        ),
        ("12", "levels = [6, 6]; realisations = [1, 1]", ""),
    ],
)
def test_a_sentence_says_what_a_change_did_and_every_number_is_one_with_the_right_noun(
    run_notebook, name, change, says
):
    run = run_notebook(name, change)
    assert any(re.search(says, each, re.DOTALL) for each in run.said), run.said
    for wrong in NEVER_SAID:
        assert not re.search(wrong, " ".join(run.said))


def test_more_noise_scatters_the_estimates_and_what_is_left_without_any_is_the_signatures(
    run_notebook,
):
    run = run_notebook("00", "noise_rps = 2.0")
    assert -8 < 100 * (run.names["A_clean"] / run.names["A_true"] - 1) < -5
    scatter = run.names["scatter"]
    assert scatter.is_monotonic_increasing
    assert scatter.iloc[0] < 0.05
    assert scatter.iloc[-1] > 0.4


def test_the_equations_of_the_search_are_those_of_the_package_without_its_additions(run_notebook):
    names = run_notebook("07", "seeds = [3]; iterations = 3").names
    c, rng = names["c"], np.random.default_rng(1)
    c = c._replace(weights=np.maximum(c.weights, 0))  # equation 17: the worse half counts nothing
    C = np.array([[2.0, 0.3], [0.3, 0.5]])
    squares, B = np.linalg.eigh(C)
    before = cmaes.State(5, np.ones(2), 0.7, C, np.array([0.2, 0.1]), np.array([0.1, -0.3]))
    z = rng.standard_normal((names["few"], 2))
    y = z @ (B * np.sqrt(squares)).T
    after = cmaes.update(before, z, y, B, c)
    x = before.m + before.sigma * y
    assert np.allclose(names["draw_members"](before.m, before.sigma, C, z), x)
    m = names["move_mean"](x)
    step = (m - before.m) / before.sigma
    p_sigma = names["extend_path"](before.p_sigma, step, C)
    p_c = names["extend_second_path"](before.p_c, step)
    sigma = names["change_step_size"](before.sigma, p_sigma)
    of_notebook = cmaes.State(6, m, sigma, names["reshape"](C, p_c, y), p_sigma, p_c)
    for ours, theirs in zip(of_notebook, after, strict=True):
        assert np.allclose(ours, theirs)


@pytest.mark.parametrize(("factor", "says"), [(0.3, "is unstable"), (0.4, "the ring grows")])
def test_a_weak_damping_gain_is_told_by_what_it_does_and_not_to_be_lowered(
    run_notebook, factor, says
):
    with pytest.raises(ParameterError, match=says) as refusal:
        run_notebook("01", f"changes = {{'K_p/J_m': {factor}}}")
    assert "lower" not in str(refusal.value)


def test_the_two_springs_find_the_clean_logs_backlash(run_notebook):
    names = run_notebook("11", "bench_seed = 7; backlash_mrad = 0.8").names
    assert abs(1e3 * names["of_clean"]["delta"] - 0.8) < 0.02
    assert abs(names["off_percent"]["m g r"]) < 0.5
