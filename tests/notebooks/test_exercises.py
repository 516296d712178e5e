"""Each exercise has a check, which in a lab copy tells right answers, honest roundings and near misses."""

import re

import jupytext
import pytest

from workbook.project import notebook_sources

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
# Answers that a student may give: right ones in another form or rounding, and near misses.
# They are worked out in the notebook after its solution, which is `right`.
ANSWERS = {
    "00": {
        "own_percent": (
            ["right + 0.4", "round(right)", "off_percent(quiet.amplitude_rps)"],
            [
                "-right",
                "right / 100",
                "off_percent(A) - right",
                "100 * (A_true / quiet.amplitude_rps - 1)",
            ],
        ),
        "forgotten_mrad": (
            ["0.04", "equation_10(0.01)", "0.0397"],
            ["equation_10(0.6)", "equation_10(0.6 * 60)", "1000 * right", "34.0313e-3"],
        ),
        "missed_percent": (
            ["right + 0.04", "round(right, 1)", "100 * (A_true + v_t - max(clean[200:])) / A_true"],
            ["-right", "right / 100", "100 - right", "A_true - clean[200:].max() + v_t"],
        ),
    },
    "01": {
        "fall_ms": (
            [
                "round(right)",
                "right + 0.9",
                "1e3 * (6 * 2 * delta / (joint.G / joint.J_l * joint.Omega / joint.N)) ** (1 / 3)",
            ],
            [
                "right / 1e3",
                "right / 2 ** (1 / 3)",
                "right / 3 ** (1 / 3)",
                "1e3 * (impacts[1] - touching[-1])",
            ],
        ),
        "alpha_1_percent": (
            ["42.4", "42", "2 / (np.pi * 0.01 * 1.5)"],
            ["42400", "2 * right", "right / 2", "100 / 1.5"],
        ),
        "weak_decay": (
            [
                "-ring_modes(change(identified, {'K_p': 0.5}))[-1].real",
                "round(right)",
                "right + 0.4",
            ],
            ["-right", "modes[-1].real", "-modes[-1].real / 2", "-ring_modes(identified)[-1].real"],
        ),
    },
    "03": {
        "peak_ratio": (
            ["round(right, 2)", "right + 0.015", "with_gains / alone"],
            ["1 / right", "1", "1 + right", "100 * right"],
        ),
        "moved_ms": (["200", "-200", "201", "600"], ["0.2", "400", "100", "0", "203"]),
        "times_as_high": (["2", "2.01", "80 / 40"], ["1", "0.5", "4", "2.05"]),
    },
    "04": {
        "twice_mrad": (
            [
                "round(right, 3)",
                "right + 0.004",
                "np.interp(2 * peaks['amplitude_rps'][1], peaks['amplitude_rps'], 1e3 * peaks['delta_rad'])",
            ],
            ["0.6", "0.3 * 2 ** (1 / power)", "0.3 * 2**1.5", "1e-3 * right"],
        ),
        "times_as_high": (
            ["round(right, 2)", "right + 0.015", "peak(identified, 1e-3) / peak(slow, 1e-3)"],
            ["2 ** (1 / 3)", "1 / right", "2", "1"],
        ),
        "tenth_rps": (
            ["130", "131", "40 / (2 * np.log(10) / 15)"],
            ["65", "261", "1 / (2 * np.log(10) / 15)", "15 * 40 / 2"],
        ),
    },
    "05": {
        "literal_rmse": (
            ["0.5", "round(right, 3)", "right + 0.009"],
            ["stored_rmse[7]", "right**2", "60 * right", "right / stored_rmse[7]"],
        ),
        "shift_s": (["-0.2", "0.6", "0.205"], ["0.1", "0.4", "0", "np.pi / X8.omega"]),
        "factor": (
            ["1.03", "1 + 0.002 * X8.tau", "round(right, 3)"],
            ["1 / right", "1", "100 * (right - 1)", "np.exp(0.001 * X8.tau)"],
        ),
    },
    "06": {
        "inverse_mrad": (
            ["0.841", "0.84", "round(right, 4)"],
            ["1e3 * polynomial(36, printed)", "1e-3 * right", "60 * right", "0.6"],
        ),
        "rounding_urad": (
            ["16", "round(right, 1)", "15.2"],
            ["1e-6 * right", "2 * right", "2 * 15.2", "0.5e-4 * theoretical[-1] ** 3"],
        ),
        "limit_rps": (
            ["1.1", "1.09", "round(right, 3)", "np.interp(2e-3, in_rpm, theoretical)"],
            ["60 * right", "right / 60", "theoretical[-1]", "polynomial(2, printed)"],
        ),
    },
    "07": {
        "mean_length": (
            ["2.55", "2.57", "np.sqrt(7) * (1 - 1 / 28 + 1 / (21 * 49))"],
            ["np.sqrt(7)", "7", "np.sqrt(6)", "2.6"],
        ),
        "mean_step": (
            ["0.29", "mean_length / np.sqrt(c.mu_eff)", "round(right, 3)"],
            [
                "np.sqrt(7 / c.mu_eff)",
                "1 / np.sqrt(c.mu_eff)",
                "mean_length / c.mu_eff",
                "mean_length / np.sqrt(c.mu)",
            ],
        ),
        "smallest": (["right + 0.0"], ["right - 1", "right + 1", "300", "right / 2"]),
    },
    "08": {
        "together_rps": (
            ["0.124", "round(right, 3)", "np.sqrt(0.1789**2 / 3 + own[10].rmse**2)"],
            [
                "0.1789 / np.sqrt(3) + own[10].rmse",
                "np.hypot(0.1789, own[10].rmse)",
                "0.1789 / np.sqrt(3)",
                "own[10].rmse",
            ],
        ),
        "distance_rps": (
            ["round(right, 3)", "regions['sd'].loc[10] * 30 / np.sqrt(29)", "right + 0.0015"],
            ["regions['sd'].loc[10]", "30 * regions['sd'].loc[10]", "right / 30", "100 * right"],
        ),
        "runs_needed": (["12.0"], ["11", "11.36", "13", "3"]),
    },
    "09": {
        "error_mrad": (
            ["round(right, 3)", "1e3 * (f(mean_A) - deltas[0])", "round(right, 2)"],
            ["-right", "1e-3 * right", "1e3 * f(mean_A)", "mean_A - known_A[0]", "-0.12"],
        ),
        "share_percent": (
            ["round(right)", "right + 0.9", "100 / (1 + 49 * best['f'] / best['d'])"],
            ["right / 100", "2", "right + 2", "right - 2"],
        ),
        "left": (
            ["[0, 0, 1]", "(0, 0, 0.995)", "np.array([0.0, 0.01, 1.0])"],
            ["[0, 1, 0]", "[1, 0, 0]", "[0, 0.5, 1]", "1", "[0, 0]", "[[0, 0, 1]]"],
        ),
    },
    "11": {
        "gravity_percent": (["4.2", "4.1", "100 / 0.96 - 100"], ["4", "-4", "8.5", "right / 100"]),
        "most_missed_percent": (
            ["29", "29.3", "100 - 100 / np.sqrt(2)"],
            ["100 / np.sqrt(2)", "at_500_hz", "right / 100", "100"],
        ),
        "growth": (
            ["0.35", "365 * np.polyfit([0, 90, 180, 270], tests_mrad, 1)[0]", "12 * 0.029"],
            ["0.25 / 270 * 365", "0.25", "right / 365.25", "4 * 0.25"],
        ),
    },
    "12": {
        "bound_a": (
            ["0.0032", "0.00316", "0.1 / np.sqrt(1000)"],
            ["0.1 / np.sqrt(2000)", "0.003", "0.1", "0.1 * 2 / 2000"],
        ),
        "rho": (
            ["round(right, 2)", "np.sqrt(1 - (sds[0] / sds[1]) ** 2)", "right + 0.015"],
            ["-right", "right**2", "sds[0] / sds[1]", "100 * right"],
        ),
        "turns_needed": (["44.0", "4 * 11"], ["22", "33", "45", "121"]),
    },
    "13": {
        "fewest": (["39.0", "2 / 0.05 - 1"], ["38", "40", "19", "20"]),
        "power_of_ten": (
            ["-12", "-11", "np.log10(np.prod(share[stored['basin']]))"],
            ["-right", "right * np.log(10)", "10**right", "30 * np.log10(1 / 3)"],
        ),
        "one_excluded": (
            ["round(right, 2)", "right + 0.009", "1 - np.exp(choices * np.log(0.99))"],
            ["0.01 * choices", "0.99**choices", "0.01", "100 * right"],
        ),
    },
    "14": {
        "earlier_ms": (
            ["13", "12.8", "400 / np.pi * np.arcsin(0.1)"],
            ["right / 2", "2 * right", "-right", "40"],
        ),
        "records_needed": (["72.0"], ["59", "71", "73", "71.92"]),
        "bits_needed": (["20.0"], ["19", "21", "19.08", "10"]),
    },
    "15": {
        "highest_percent": (
            ["26", "100 * (1 - 0.025 ** (1 / 12))", "27"],
            ["100 * (1 - 0.05 ** (1 / joints))", "300 / joints", "right / 100", "0"],
        ),
        "sure": (["right + 0.0"], ["right + 1", "right - 1", "right + 0.5", "0"]),
        "half_play_mrad": (
            ["1.31", "1e3 * 0.075 * 3.14159 / 180", "1.3"],
            ["2.62", "0.075", "1.31e-3", "0.15"],
        ),
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
        check = cells[position + 1].source
        answer = re.search(r"check_answer\(\s*(\w+),", check)[1]
        text = " ".join(cells[position - 1].source.split())
        asked = re.search(rf"\(`{answer}`([^)]*)\)", text)[1]
        precision = re.search(r"\bto=([\d.]+)", check)
        words = f"to {precision[1]}" if precision else "a whole number"
        assert words in asked, (answer, asked)


def assert_checks_tell(answer_exercises, notebook):
    answers = {
        name: dict.fromkeys(right, "right") | dict.fromkeys(wrong, "not yet")
        for name, (right, wrong) in ANSWERS[notebook].items()
    }
    exercises = answer_exercises(notebook, answers, **FASTER.get(notebook, {}))
    assert len(exercises) == len(answers)
    for each in exercises:
        assert each.blank == "", each.name
        assert each.of_solution == "right", each.name
        assert set(each.of_roundings) == {"right"}, (each.name, each.of_roundings)
        assert set(each.of_misses) == {"not yet"}, (each.name, each.of_misses)
        assert each.of_others == answers[each.name], each.name
        assert each.of_word == "not yet: 'one' is not a number"


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
    answers = {answer: [number] for answer, number in of_committed.items()}
    exercises = answer_exercises(name, answers, tuple(code.split(" → ")), **FASTER.get(name, {}))
    assert {each.of_solution for each in exercises} == {"right"}
    said = {each.name: [*each.of_others.values()] for each in exercises}
    assert said == {each.name: ["not yet"] * (each.name in of_committed) for each in exercises}
