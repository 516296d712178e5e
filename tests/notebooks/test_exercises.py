"""Each exercise has a check, which in a lab copy tells right answers, honest roundings and near misses."""

import re

import jupytext
import pytest

from tests.notebooks.conftest import exercise_of
from workbook.project import notebook_sources

SOURCES = notebook_sources()
# Answers are worked out in the notebook after its solution, which is `right`: honest roundings, and near misses and
# slips in sign, factor and unit, which are wrong where they are not listed as right.
RIGHT = ["right", "to * np.round(right / to)", "to * np.trunc(right / to)"]
MISSES = ["right + off", "right - off", "right + 37 * off"]
SLIPS = [f"{factor:g} * right" for factor in (-1, 2, 0.5, 100, 0.01, 60, 1 / 60, 1e3, 1e-3)]
# What a student may answer besides: what is right in another form, and what is not.
ANSWERS = {
    "00": {
        "hidden_rps": (
            ["A_true * 3**0.5", "np.sqrt(12) * A_true / 2"],
            ["A_true", "A_true / np.sqrt(3)"],
        ),
        "forgotten_mrad": (["equation_10(0.01)", "0.0397"], ["equation_10(0.6)"]),
        "missed_percent": (
            ["100 * (A_true + v_t - max(clean[200:])) / A_true"],
            ["100 - right", "A_true - clean[200:].max() + v_t"],
        ),
    },
    "01": {
        "fall_ms": (
            ["1e3 * (6 * 2 * delta / (joint.G / joint.J_l * joint.Omega / joint.N)) ** (1 / 3)"],
            ["right / 2 ** (1 / 3)", "1e3 * (impacts[1] - touching[-1])"],
        ),
        "alpha_1_percent": (["42.4", "2 / (np.pi * 0.01 * 1.5)"], ["100 / 1.5"]),
        "weak_decay": (
            ["-ring_modes(change(identified, {'K_p': 0.5}))[-1].real"],
            ["-modes[-1].real / 2", "-ring_modes(identified)[-1].real"],
        ),
    },
    "03": {
        "peak_ratio": (["with_gains / alone"], ["1 / right", "1"]),
        "moved_ms": (["200", "-1 * right", "600"], ["400", "0", "203"]),
        "times_as_high": (["80 / 40"], ["2.05"]),
    },
    "04": {
        "twice_mrad": (
            [
                "np.interp(2 * peaks['amplitude_rps'][1], peaks['amplitude_rps'], 1e3 * peaks['delta_rad'])"
            ],
            ["0.3 * 2 ** (1 / power)", "0.3 * 2**1.5"],
        ),
        "times_as_high": (
            ["peak(identified, 1e-3) / peak(slow, 1e-3)"],
            ["2 ** (1 / 3)", "1 / right"],
        ),
        "tenth_rps": (["130", "40 / (2 * np.log(10) / 15)"], ["1 / (2 * np.log(10) / 15)"]),
    },
    "05": {
        "literal_rmse": (["0.5"], ["stored_rmse[7]", "right**2"]),
        "shift_s": (["-1 * right", "0.6"], ["0", "np.pi / X8.omega"]),
        "factor": (["1.03", "1 + 0.002 * X8.tau"], ["1 / right", "np.exp(0.001 * X8.tau)"]),
    },
    "06": {
        "inverse_mrad": (
            ["0.841", "np.array([0.8409])", "[right]"],
            ["1e3 * polyval(36, printed)"],
        ),
        "rounding_urad": (["16"], ["0.5e-4 * theoretical[-1] ** 3"]),
        "limit_rps": (["1.1", "np.interp(2e-3, in_rpm, theoretical)"], ["theoretical[-1]"]),
    },
    "07": {
        "mean_length": (
            ["2.55", "np.sqrt(7) * (1 - 1 / 28 + 1 / (21 * 49))"],
            ["np.sqrt(7)", "np.sqrt(6)"],
        ),
        "mean_step": (
            ["0.29", "mean_length / np.sqrt(c7.mu_eff)"],
            ["np.sqrt(7 / c7.mu_eff)", "mean_length / np.sqrt(c7.mu)"],
        ),
        "smallest": ([], ["300"]),
    },
    "08": {
        "together_rps": (
            ["0.124", "np.sqrt(0.1789**2 / 3 + own[10].rmse**2)"],
            ["np.hypot(0.1789, own[10].rmse)", "0.1789 / np.sqrt(3)"],
        ),
        "distance_rps": (["regions['sd'].loc[10] * 30 / np.sqrt(29)"], ["regions['sd'].loc[10]"]),
        "runs_needed": (["12.0"], ["11.36", "3"]),
    },
    "09": {
        "error_mrad": (["1e3 * (f(mean_A) - deltas[0])"], ["mean_A - known_A[0]", "-0.12"]),
        "share_percent": (["100 / (1 + 49 * best['f'] / best['d'])"], ["2"]),
        "left": (
            ["[0, 0, 1]", "(0, 0, 0.995)", "np.array([0.0, 0.01, 1.0])"],
            ["[0, 0.5, 1]", "1", "[0, 0]", "[[0, 0, 1]]"],
        ),
    },
    "11": {
        "inertia_percent": (["100 * (of_lighter['delta'] - delta) / delta"], ["10"]),
        "wind_up_mrad": (
            ["1e3 * abs(in_time(harmonics(clean)[1])).max() / of_clean['K_s']"],
            ["1e3 * amplitude / my_joint.K_s"],
        ),
        "lost_mrad": (
            ["2e3 * (of_clean['delta'] + 2 / of_clean['K_s'])"],
            ["backlash_mrad + 4e3 / my_joint.K_s"],
        ),
    },
    "12": {
        "bound_a": (["0.0032", "0.1 / np.sqrt(1000)"], ["0.1 / np.sqrt(2000)", "0.003"]),
        "rho": (["np.sqrt(1 - (sds[0] / sds[1]) ** 2)"], ["sds[0] / sds[1]"]),
        "turns_needed": (["44.0", "4 * 11"], ["33"]),
    },
    "13": {
        "fewest": (["39.0", "2 / 0.05 - 1"], ["19", "20"]),
        "power_of_ten": (
            ["-12", "np.log10(np.prod(share[stored['basin']]))"],
            ["right * np.log(10)", "30 * np.log10(1 / 3)"],
        ),
        "one_excluded": (
            ["1 - np.exp(choices * np.log(0.99))"],
            ["0.01 * choices", "0.99**choices"],
        ),
    },
    "14": {
        "earlier_ms": (["13", "400 / np.pi * np.arcsin(0.1)"], ["40"]),
        "records_needed": (["72.0"], ["59", "71.92"]),
        "bits_needed": (["20.0"], ["19.08", "10"]),
    },
    "15": {
        "highest_percent": (
            ["100 * (1 - 0.025 ** (1 / 13))"],
            ["100 * (1 - 0.05 ** (1 / joints))", "300 / joints"],
        ),
        "sure": ([], ["0"]),
        "half_play_mrad": (["1.31", "1e3 * 0.075 * 3.14159 / 180"], ["0.075", "0.15"]),
    },
}


@pytest.mark.parametrize("name", SOURCES)
def test_each_of_three_exercises_says_how_precisely_it_asks_and_is_followed_by_its_check(name):
    cells = jupytext.read(SOURCES[name]).cells
    tags = [cell.metadata.get("tags", []) for cell in cells]
    solutions = [position for position, each in enumerate(tags) if "solution" in each]
    assert len(solutions) == 3
    for position in solutions:
        assert "check" in tags[position + 1]
        answer, precision = exercise_of(cells[position + 1].source)
        text = " ".join(cells[position - 1].source.split())
        asked = re.search(rf"\(`{answer}`([^)]*)\)", text)[1]
        words = f"to {precision}" if precision else "a whole number"
        assert words in asked, (answer, asked)


def assert_checks_tell(answer_exercises, notebook):
    expected = {
        exercise: dict.fromkeys(MISSES + SLIPS + wrong, "not yet")
        | dict.fromkeys(RIGHT + right, "right")
        for exercise, (right, wrong) in ANSWERS[notebook].items()
    }
    assert answer_exercises(notebook, expected.get) == expected


@pytest.mark.slow
@pytest.mark.parametrize("name", [name[:2] for name in SOURCES if not name.startswith("15")])
def test_a_check_tells_the_solution_and_its_roundings_from_near_misses(answer_exercises, name):
    assert_checks_tell(answer_exercises, name)


@pytest.mark.slow
def test_a_check_tells_answers_on_logs_of_real_joints(answer_exercises, hardware_logs):
    assert_checks_tell(answer_exercises, "15")


def with_joint(factors):
    return f"identified_joint() → change(identified_joint(), {factors})"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "code", "of_committed"),
    [
        ("00", "published.value( → 1.1 * published.value(", {"forgotten_mrad": "0.0397"}),
        ("01", with_joint({"K_p/J_m": 0.8}), {"weak_decay": "-4.75"}),
        ("03", with_joint({"K_p/J_m": 0.8}), {"peak_ratio": "0.582"}),
        ("04", with_joint({"G/J_l": 1.5}), {"twice_mrad": "0.756"}),
        ("04", with_joint({"K_s/J_l": 0.5}), {"times_as_high": "1.153"}),
        ("05", "load_clean(12) → load_clean(6)", {"literal_rmse": "0.5"}),
        (
            "06",
            "[: delta.size]\n → [: delta.size] * 1.05\n",
            {"inverse_mrad": "0.841", "rounding_urad": "15.9"},
        ),
        ("06", 'A{k}") → A{k}") * 1.05', {"limit_rps": "1.096"}),
        (
            "09",
            "# of A in rps, by equation 10 → \nf = lambda A, f=f: 1.1 * f(A)",
            {"error_mrad": "-0.112"},
        ),
        ("13", ".to_numpy()) → .to_numpy().round(1))", {"power_of_ten": "-11.7"}),
    ],
)
def test_a_check_follows_what_its_notebook_computes(answer_exercises, name, code, of_committed):
    def answers(exercise):
        return {"right": "right", of_committed.get(exercise, "1e3 * right"): "not yet"}

    said = answer_exercises(name, answers, code)
    assert said == {exercise: answers(exercise) for exercise in said}
    assert said.keys() >= of_committed.keys()
