"""What would have changed a verdict by evidence: each change is made, and the verdict changes."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from replication import characteristic, published, table2
from replication.authors import load_clean
from replication.files import ROOT
from replication.replay import inspection, table1
from replication.simulator.parameters import identified_joint, with_ratios
from tests.tools.reference import simulate_amplitudes
from workbook import judging
from workbook.outcomes import load_outcomes

RESULTS = ROOT / "results"
AGREEING = ("reproduced", "traced")


def verdict(cell, numbers, source="authors"):
    return judging.judge_cells({cell: numbers}, source)["verdict"].item()


def exported():
    """Every number that a notebook exported and that evidence or a trace decided: id, source, numbers, verdict."""
    table = judging.verdicts(RESULTS).set_index(["id", "source"])["verdict"]
    rows = [row for outcome in load_outcomes(RESULTS).values() for row in outcome["cells"]]
    found = [
        (row["id"], row["source"], row["numbers"], table[row["id"], row["source"]]) for row in rows
    ]
    counted = (*judging.EVIDENCE, "traced")
    return [pytest.param(*row, id=f"{row[0]}-{row[1]}") for row in found if row[3] in counted]


def interval(cell, numbers):
    """The region that judges a cell."""
    if isinstance(numbers, list):
        return judging.region(numbers, published.cells().loc[cell, "kind"] == "signed")
    return numbers - published.tolerance(cell), numbers + published.tolerance(cell)


def moved(numbers, shift=0.0, factor=1.0):
    return factor * np.asarray(numbers) + shift


@pytest.mark.parametrize(("cell", "source", "numbers", "now"), exported())
def test_a_verdict_by_evidence_changes_when_our_number_moves(cell, source, numbers, now):
    assert verdict(cell, numbers, source) == now
    if now in AGREEING:
        low, high = interval(cell, numbers)
        width = min(high, low + abs(low) + 1) - low
        assert verdict(cell, moved(numbers, shift=1.01 * width), source) != now
        if np.any(numbers):
            assert verdict(cell, moved(numbers, factor=1.3), source) != now
    else:
        printed = published.value(cell)
        agreeing = [printed * (1 + share) for share in (-2e-3, -1e-3, 0, 1e-3, 2e-3)]
        ours = agreeing if isinstance(numbers, list) else printed
        assert verdict(cell, ours, source) in AGREEING


def test_there_are_numbers_judged_by_evidence():
    assert exported()


@pytest.mark.parametrize(("cell", "source", "numbers", "now"), exported())
def test_a_verdict_by_evidence_changes_when_the_printed_number_moves(
    cell, source, numbers, now, monkeypatch
):
    low, high = interval(cell, numbers)
    cells = published.cells()
    bound = cells.loc[cell, "kind"] == "bound"
    wrong = (low if bound else high) + (-1 if bound else 1) * 1.01 * (high - low)
    cells.loc[cell, "value"] = wrong if now in AGREEING else 0.5 * (low + high)
    monkeypatch.setattr(published, "_cells", lambda: cells)
    assert verdict(cell, numbers, source) != now


def test_a_verdict_on_table_2_changes_with_the_runs():
    table = pd.read_csv(RESULTS / "table2.csv")
    authors = table[table["source"] == "authors"]
    before = {
        cell: verdict(cell, numbers) for cell, numbers in table2.table2_cells(authors).items()
    }
    absurd = table2.table2_cells(authors.assign(mean_A_rps=999.0, sd_A_rps=999.0))
    assert set(before) == set(absurd)
    for cell, numbers in absurd.items():
        assert verdict(cell, numbers) == "differs"
    assert "reproduced" in before.values()


def test_every_basis_of_evidence_names_a_change_and_the_test_that_makes_it():
    table = published.basis()
    evidence = table[table["basis"].isin(["evidence", "traced"])]
    assert (evidence["fails_if"] != "").all()
    here = {
        f"tests/workbook/test_evidence.py::{name}" for name in globals() if name.startswith("test_")
    }
    assert set(evidence["test"]) <= here


def test_the_turn_period_of_the_data_differs_unless_it_is_the_printed_one(record_12):
    tried = pd.DataFrame(columns=["cell", "shift", "bound", "replayed"])
    for factor, expected in ((1.0, "differs"), (1.02, "traced"), (1.05, "differs")):
        slower = replace(record_12, t=factor * record_12.t)
        for cell, value in table1.table1_cells(slower, tried).items():
            assert verdict(cell, value) == expected


@pytest.mark.parametrize(
    "cell",
    [
        cell
        for cell in published.cells("Table 1").index
        if cell.split(".")[1] not in ("A", "T_d", "T_f")
    ],
)
def test_a_bound_that_is_off_loses_the_stored_first_generations(record_12, cell):
    tried = pd.DataFrame({"cell": cell, "shift": table1.SHIFTS})
    printed = published.value(cell)
    lower, upper = (published.value(f"{cell.rpartition('.')[0]}.{side}") for side in ("min", "max"))
    t, v, name = record_12.t, record_12.v, cell.split(".")[1]
    scale, offset = {"t0": (np.ptp(t), t[0]), "v_t": (np.ptp(v), v.min())}.get(name, (1.0, 0.0))
    places = offset + scale * (printed + (upper - lower) * tried["shift"])
    for best, expected in ((0.0, "traced"), (0.1, "differs")):
        counts = np.where(tried["shift"] == best, 30, 1)
        value = table1.table1_cells(record_12, tried.assign(bound=places, replayed=counts))[cell]
        assert verdict(cell, value) == expected


def test_another_joint_has_other_peaks():
    joint = identified_joint()
    ours = simulate_amplitudes(joint)
    softer = with_ratios(joint, {"stiffness_per_s2": 0.8 * joint.ratios["stiffness_per_s2"]})
    for row, (peak, other) in enumerate(
        zip(ours, simulate_amplitudes(softer), strict=True), start=1
    ):
        assert verdict(f"table2.row{row:02d}.theoretical", peak, "simulated") == "consistent"
        assert verdict(f"table2.row{row:02d}.theoretical", other, "simulated") == "differs"


def test_higher_peaks_in_the_records_are_noticed(authors_data):
    for row in range(2, 11):
        record = load_clean(row + 1)
        for factor, expected in ((1, "traced"), (1.05, "differs")):
            higher = replace(record, v=100 + factor * (record.v - 100))
            peak = inspection.interpolated_peak_rps(higher)
            assert verdict(f"table2.row{row:02d}.theoretical", peak) == expected


@pytest.mark.slow
def test_another_noise_in_the_records_is_noticed(authors_data, monkeypatch):
    loaded = inspection.load_noisy

    def louder(level, realisation):
        record = loaded(level, realisation)
        clean = 100.0 if level < 3 else load_clean(level).v
        return replace(record, v=clean + 1.1 * (record.v - clean))

    monkeypatch.setattr(inspection, "load_noisy", louder)
    for row, amplitude in enumerate(inspection.noise_amplitudes(), start=1):
        assert verdict(f"table2.row{row:02d}.noise", amplitude) == "differs"


def test_another_rmse_of_equation_10_is_no_erratum():
    delta = characteristic.printed_levels_rad()
    theoretical = published.column("Table 2", "theoretical")[: delta.size]

    def rmse(amplitude):
        cubic = np.polyfit(amplitude, delta, 3)
        return float(np.sqrt(np.mean((np.polyval(cubic, amplitude) - delta) ** 2)))

    assert verdict("equation10.rmse", rmse(theoretical)) == "erratum"
    moved = np.where(np.arange(delta.size) == 4, 1.01 * theoretical, theoretical)
    assert verdict("equation10.rmse", rmse(moved)) == "differs"


def test_another_speed_is_noticed(record_12):
    assert verdict("text.commanded_speed", float(np.median(1.01 * record_12.v))) == "differs"


def test_a_worse_mean_breaks_the_limit_on_errors():
    assert verdict("text.error_limit_percent", [14.0, 14.5, 15.0, 15.5, 16.0]) == "differs"
    assert verdict("text.error_limit_percent", [7.0, 7.1, 7.2, 7.3, 7.4]) == "reproduced"
