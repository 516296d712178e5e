"""Twelve changes that a reader may want to make: two lines of a notebook at most, and it says what happened.

A line is a parameter, or one that is edited as it stands in the source. Run by `make changes`.
"""

import numpy as np
import pandas as pd
import pytest
from test_try_changing import a_small_population_settles_early_in_a_bad_minimum

from replication.standins import joints
from tests.tools.changes import run, says_what_happened

HUBER = "np.mean(np.where(np.abs(r) < 0.05, r**2 / 2, 0.05 * (np.abs(r) - 0.025)))"


def gaussian_noise(n):
    assert (n["log"].v - n["clean"].v).std() == pytest.approx(n["noise_rps"], rel=0.05)
    assert n["answer"].backlash_interval_rad[0] < n["delta_rad"]


def louder_noise(n):
    here, kept = (n[table].groupby("row")["mean_A_rps"].std() for table in ("own", "kept"))
    assert (here / kept).median() > 1.5
    assert n["same_law"] < 0.01


def narrow_box(n):
    assert n["ratio"] == pytest.approx(4, abs=0.3)
    assert n["found"].best[3] == pytest.approx(2 * np.pi * 15, rel=1e-3)  # omega ends at its bound


def early_start(n):
    assert n["found"].best[1] < 0.05
    assert n["ratio"] == pytest.approx(1, abs=0.3)


def two_frequencies(n):
    usual, yours = n["fits"].iloc[0], n["fits"].iloc[-1]
    assert (usual["signature"], yours["signature"]) == ("the paper's", "your")
    assert yours["RMSE [rps]"] != pytest.approx(usual["RMSE [rps]"], rel=1e-3)
    assert (n["off"] < 1e-6).all()  # the stored runs have one frequency


def another_gear(n):
    assert not n["compared"]
    assert n["cells"]["simulated"] == {}  # the records still give their own peaks
    assert n["peak_change_percent"].mean() == pytest.approx(-7.4, abs=1)


def friction(n):
    assert 0.2 < n["table"]["nrmse"].mean() < 0.4


def coarse_samples(n):
    assert n["log"].sample_s == pytest.approx(4e-3)
    assert n["log"].v.size < 1300


def another_optimiser(n):
    row = n["costs"].set_index("strategy").loc["differential_evolution"]
    assert row["runs"] == n["strategy_runs"]
    assert row["mean_evaluations"] <= n["budget"]


def huber_cost(n):
    usual, yours = n["fits"].iloc[0], n["fits"].iloc[-1]
    assert yours["cost"] == "your function"
    assert yours["mean |residual| [rps]"] < usual["mean |residual| [rps]"]
    assert yours["RMSE [rps]"] > usual["RMSE [rps]"]


def a_log_of_ones_own(n):
    low, high = n["my_answer"].backlash_interval_rad
    assert n["my_answer"].verdict == "backlash"
    assert low < 8e-4 < high


# The notebook, parameters, edited lines, and what is checked.
SIGNATURE, SIMULATOR, SEARCH = (
    "05_signature_figure6",
    "03_simulator_figure10",
    "07_protocol_table1",
)
CHANGES = {
    "Gaussian noise": (
        "00_the_sensor",
        {},
        {
            "log = add_uniform_noise(clean, noise_rps, np.random.default_rng(seed))": (
                "rng = np.random.default_rng(seed)\n"
                "log = replace(clean, v=clean.v + rng.normal(0, noise_rps, clean.v.size))"
            )
        },
        gaussian_noise,
    ),
    "Gaussian noise in Table 2": (
        "08_noise_table2",
        {},
        {"rng.uniform(-a, a, size)": "rng.normal(0, 2 * a, size)"},
        louder_noise,
    ),
    "box of omega": (SEARCH, {"box": {"frequency_hz": (1.0, 15.0)}}, {}, narrow_box),
    "box of t0": (SEARCH, {"box": {"start_s": (0.0, 0.05)}}, {}, early_start),
    "population": (
        SEARCH,
        {"population": 20},
        {},
        a_small_population_settles_early_in_a_bad_minimum,
    ),
    "two frequencies": (
        SIGNATURE,
        {"more_bounds": [(200.0, 500.0)]},
        {
            "np.sin(omega * (t - t0))": (
                "(np.sin(omega * (t - t0)) + sum(0.3 * np.sin(w * (t - t0)) for w in X[7:]))"
            )
        },
        two_frequencies,
    ),
    "gear ratio": (SIMULATOR, {"changes": {"gear_ratio": 1.25}}, {}, another_gear),
    "friction": (SIMULATOR, {"friction_share": 0.02}, {}, friction),
    "4 ms sampling": (
        "00_the_sensor",
        {},
        {
            "simulate_recordings(joint, [delta_rad])": (
                "simulate_recordings(joint, [delta_rad], sample_s=4e-3)"
            )
        },
        coarse_samples,
    ),
    "optimiser": (
        "17_identification",
        {},
        {"optimiser = None": "optimiser = differential_evolution"},
        another_optimiser,
    ),
    "Huber cost": (SIGNATURE, {}, {'cost = "RMSE"': f"cost = lambda r: {HUBER}"}, huber_cost),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_is_two_lines_at_most_and_the_notebook_says_what_happened(
    change, authors_data, tmp_path, capsys
):
    notebook, parameters, edits, check = CHANGES[change]
    lines = len(parameters) + sum(1 + edited.count("\n") for edited in edits.values())
    assert lines <= 2
    check(run(notebook, parameters, tmp_path, edits))
    assert says_what_happened(capsys.readouterr().out)


def test_a_log_of_ones_own_is_measured_first_and_says_what_was_assumed(tmp_path, capsys):
    """The log of a bench that no notebook knows."""
    bench = joints.draw_bench(np.random.default_rng(8))
    record = joints.encoder_log(bench, 8e-4, np.random.default_rng(9))
    path = tmp_path / "mine.csv"
    pd.DataFrame({"time [s]": record.t, "motor speed [rps]": record.v}).to_csv(path, index=False)
    own = {"my_log": str(path), "my_turn_period_s": record.turn_period_s}
    n = run("12_your_own_joint", own, tmp_path / "out")
    a_log_of_ones_own(n)
    printed = capsys.readouterr().out
    assert printed.startswith(str(n["my_answer"]))
    assert "assumed: a load turn of 0.4 s" in printed


def test_a_log_that_is_not_there_is_refused_in_one_sentence_with_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"nowhere\.csv: no such file in /.*; check") as error:
        run("12_your_own_joint", {"my_log": "nowhere.csv"}, tmp_path)
    assert "\n" not in str(error.value)
    assert str(tmp_path) in str(error.value)
