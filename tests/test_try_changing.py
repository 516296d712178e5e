"""Every change that a notebook proposes, and ten more that a reader may want, of two lines at most.

Each runs, and the notebook ends in a sentence on what happened, which names what was changed. Notebooks run in this
process with their quick parameters, those of `CHEAPER` and the change. `make changes` runs this, once a week; that a
change is allowed, `make test` tests (`tests/notebooks/test_changes.py`).
"""

import os

import numpy as np
import pandas as pd
import pytest

from replication import standins
from tests.changes import NOTEBOOKS, changes, parse, run, says_what_happened

HUBER = "np.mean(np.where(np.abs(r) < 0.05, r**2 / 2, 0.05 * (np.abs(r) - 0.025)))"
SIN = "np.sin(omega * (t - t0))"

# The notebook, parameters, and lines as they stand in the source with what they become.
MORE = {
    "Gaussian noise": ("00_the_sensor", {"noise_law": "normal"}, {}),
    "Gaussian noise in Table 2": (
        "15_protocols",
        {},
        {"rng.uniform(-a, a, size)": "rng.normal(0, 2 * a, size)"},
    ),
    "box of omega": ("07_protocol_table1", {"box": {"frequency_hz": (1.0, 15.0)}}, {}),
    "box of t0": ("07_protocol_table1", {"box": {"start_s": (0.0, 0.05)}}, {}),
    "two frequencies": (
        "05_signature_figure6",
        {"more_bounds": [(200.0, 500.0)]},
        {SIN: f"({SIN} + sum(0.3 * np.sin(w * (t - t0)) for w in X[7:]))"},
    ),
    "gear ratio": ("03_simulator_figure10", {"changes": {"gear_ratio": 1.25}}, {}),
    "friction": ("03_simulator_figure10", {"friction_share": 0.02}, {}),
    "softer coupling": ("02_dead_zone_figure9", {"stiffness_factor": 1e-3}, {}),
    "optimiser": (
        "20_another_optimiser",
        {},
        {'optimiser = "none"': "optimiser = differential_evolution"},
    ),
    "Huber cost": ("05_signature_figure6", {}, {'cost = "RMSE"': f"cost = lambda r: {HUBER}"}),
}
PROPOSED = {
    f"{name}, {change}": (name, parse(change), {}) for name in NOTEBOOKS for change in changes(name)
}


@pytest.mark.parametrize("change", PROPOSED | MORE)
def test_a_notebook_runs_with_a_change_names_it_and_says_what_happened(
    change, authors_data, tmp_path, capsys
):
    notebook, parameters, edits = (PROPOSED | MORE)[change]
    if notebook == "17_logs_of_real_joints" and not os.environ.get("HARDWARE_LOGS"):
        pytest.skip("needs logs of real joints, in the folder HARDWARE_LOGS")
    run(notebook, parameters, tmp_path, edits)
    reassigned = [edited.partition(" = ")[0] for edited in edits.values() if " = " in edited]
    assert says_what_happened(capsys.readouterr().out, [*parameters, *reassigned])


def test_a_log_of_ones_own_is_measured_first_and_says_what_was_assumed(tmp_path, capsys):
    """The log of a bench that no notebook knows."""
    bench = standins.draw_bench(np.random.default_rng(8))
    record = standins.encoder_log(bench, 8e-4, np.random.default_rng(9))
    path = tmp_path / "mine.csv"
    pd.DataFrame({"time [s]": record.t, "motor speed [rps]": record.v}).to_csv(path, index=False)
    own = {"my_log": str(path), "my_turn_period_s": record.turn_period_s}
    answer = run("12_your_own_joint", own, tmp_path / "out")["my_answer"]
    low, high = answer.backlash_interval_rad
    assert low < 8e-4 < high
    printed = capsys.readouterr().out
    assert printed.startswith(str(answer))
    assert "assumed: a load turn of 0.4 s" in printed


def test_a_log_that_is_not_there_is_refused_in_one_sentence_with_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=rf"nowhere\.csv: no such file in {tmp_path}.*; check"):
        run("12_your_own_joint", {"my_log": "nowhere.csv"}, tmp_path)
