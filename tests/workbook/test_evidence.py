"""What would have changed a verdict by evidence: each change is made, and the verdict changes."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from replication import characteristic, published
from replication.authors import load_clean
from replication.files import ROOT
from replication.simulator.parameters import identified_joint, with_ratios
from studies.reference import simulate_amplitudes
from studies.replay import inspection, protocols, table1
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
    if isinstance(numbers, dict):
        return judging.compare_candidates(cell, numbers)[2]
    return numbers - published.tolerance(cell), numbers + published.tolerance(cell)


def moved(numbers, shift=0.0, factor=1.0):
    if isinstance(numbers, dict):
        return {name: moved(np.array(of), shift, factor).tolist() for name, of in numbers.items()}
    return factor * numbers + shift


@pytest.mark.parametrize(("cell", "source", "numbers", "now"), exported())
def test_a_verdict_by_evidence_changes_when_our_number_moves(cell, source, numbers, now):
    assert verdict(cell, numbers, source) == now
    if now in AGREEING:
        low, high = interval(cell, numbers)
        width = min(high, low + abs(low) + 1) - low
        assert verdict(cell, moved(numbers, shift=1.01 * width), source) != now
        if np.any(np.concatenate([*numbers.values()]) if isinstance(numbers, dict) else numbers):
            assert verdict(cell, moved(numbers, factor=1.3), source) != now
    else:
        printed = published.value(cell)
        agreeing = printed
        if isinstance(numbers, dict):
            agreeing = {"a": list(printed * np.linspace(0.99, 1.01, 41))}
        assert verdict(cell, agreeing, source) in AGREEING


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


@pytest.mark.parametrize("of", ["mean", "sd"])
def test_a_verdict_on_table_2_changes_with_the_runs(of):
    """From the study's table to the verdict: the realisations of every candidate are moved in it."""
    study = pd.read_csv(protocols.REALISATIONS)
    for factor in (0.5, 2.0):
        other = study.assign(**{f"{of}_A_rps": factor * study[f"{of}_A_rps"]})
        rest = study[study["row"] != 3]
        cell = f"table2.row03.{of}"
        numbers = protocols.judges_of_cells(pd.concat([rest, other[other["row"] == 3]]))[cell]
        kept = protocols.judges_of_cells(study)[cell]
        assert list(numbers) == list(kept)  # a cell does not choose its judges
        assert verdict(cell, numbers) != "reproduced"
        assert judging.judge_cells({cell: numbers}, "authors")[
            "reproduced"
        ].item() == pytest.approx(
            factor * judging.judge_cells({cell: kept}, "authors")["reproduced"].item()
        )


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


@pytest.mark.parametrize(("off", "expected"), [(0.0, "traced"), (1 / 9, "differs")])
def test_a_bound_that_is_off_loses_the_stored_first_generations(
    record_12, monkeypatch, off, expected
):
    """Two runs replay in boxes around a printed bound; off by a ninth of its range, they do at a tenth of it below."""
    cell, cells = "table1.tau.max", published.cells()
    cells.loc[cell, "value"] += 25 * off
    stored = published.authors_notebook_runs().head(2)
    monkeypatch.setattr(published, "_cells", lambda: cells)
    monkeypatch.setattr(published, "authors_notebook_runs", lambda: stored)
    monkeypatch.setattr(table1, "NAMES", table1.NAMES[:3])
    tried = table1.bounds_by_replay(record_12)
    assert verdict(cell, table1.table1_cells(record_12, tried)[cell]) == expected


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
    for low, high, expected in ((14, 16, "differs"), (7, 7.4, "reproduced"), (9, 11, "undecided")):
        largest = {"a": np.linspace(low, high, 40).tolist()}
        assert verdict("text.error_limit_percent", largest) == expected
