"""Ten changes that a reader may want to make: each is one edit of a parameter, and the notebook says what happened.

Those that a notebook proposes itself (`PROPOSED`), and a log of one's own in notebook 12, are in `test_try_changing`.
Run by `make changes`.
"""

import numpy as np
import pytest
from test_try_changing import OUTCOMES

from tests.tools.changes import run, says_what_happened


def narrow_box(n):
    assert n["ratio"] == pytest.approx(4, abs=0.3)
    assert n["found"].best[3] == pytest.approx(2 * np.pi * 15, rel=1e-3)  # omega ends at its bound


def another_speed(n):
    assert n["T_f"] == pytest.approx(0.8)
    assert n["against"].mean() == pytest.approx(-14.3, abs=1)


def friction(n):
    assert 0.2 < n["table"]["nrmse"].mean() < 0.4


def the_motors_inertia(n):
    assert n["peak_change_percent"].mean() == pytest.approx(13, abs=1.5)


def the_inertia_ratio(n):
    assert n["peak_change_percent"].mean() == pytest.approx(-35, abs=1.5)
    assert n["joint"].speed_gain_nms_per_rad == pytest.approx(
        2 * n["committed"].speed_gain_nms_per_rad
    )


def another_gear(n):
    assert not n["compared"]
    assert n["cells"]["simulated"] == {}  # the records still give their own peaks
    assert n["peak_change_percent"].mean() == pytest.approx(-7.4, abs=1)


def louder_noise(n):
    here, kept = (n[table].groupby("row")["mean_A_rps"].std() for table in ("own", "kept"))
    assert (here / kept).median() > 2


class _Name:
    """A function of the notebook, as the parameter cell would name it."""

    def __repr__(self):
        return "differential_evolution"


def another_optimiser(n):
    row = n["costs"].set_index("strategy").loc["differential_evolution"]
    assert row["runs"] == n["strategy_runs"]
    assert row["mean_evaluations"] <= n["budget"]


def half_a_milliradian(n):
    assert n["delta_rad"] == pytest.approx(5e-4)
    assert abs(n["error_percent"]) < 30
    low, high = n["answer"].backlash_interval_rad
    assert low < 5e-4 < high


PROPOSED = {
    "01_signature_figure6": ('cost = "L1"', "turn_period_s = 0.408"),
    "06_characteristic_figure12": ('reading = "energy"',),
    "07_protocol_table1": ("population = 20", "sigma = 0.02"),
}
EDITS = {
    "box": ("07_protocol_table1", {"box": {"frequency_hz": (1.0, 15.0)}}, narrow_box),
    "turn period of the joint": (
        "05_growth_figure11",
        {"commanded_speed_rps": 50.0},
        another_speed,
    ),
    "friction": ("04_simulator_figure10", {"friction_share": 0.02}, friction),
    "motor inertia": (
        "04_simulator_figure10",
        {"changes": {"motor_inertia_kgm2": 2.0}},
        the_motors_inertia,
    ),
    "inertia ratio": (
        "04_simulator_figure10",
        {"changes": {"inertia_ratio": 0.5}},
        the_inertia_ratio,
    ),
    "noise": ("08_noise_table2", {"noise_factor": 4.0, "fresh": 5}, louder_noise),
    "optimiser": (
        "09_identification",
        {
            **{
                "optimiser": _Name(),
                "replay_runs": 6,
                "strategy_runs": 2,
                "budget": 5000,
                "coverage_runs": 1,
            },
            "strategies": ["population 100, restarted"],
        },
        another_optimiser,
    ),
    "0.5 mrad end to end": ("00_start_here", {"backlash_mrad": 0.5}, half_a_milliradian),
    "gear ratio": ("04_simulator_figure10", {"changes": {"gear_ratio": 1.25}}, another_gear),
}


@pytest.mark.parametrize("change", EDITS)
def test_a_change_is_one_edit_and_the_notebook_says_what_happened(
    change, authors_data, tmp_path, capsys
):
    notebook, parameters, check = EDITS[change]
    check(run(notebook, parameters, tmp_path))
    assert says_what_happened(capsys.readouterr().out)


def test_the_other_changes_are_proposed_by_their_notebooks():
    for notebook, proposed in PROPOSED.items():
        assert set(proposed) <= set(OUTCOMES[notebook])
