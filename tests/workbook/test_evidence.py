"""What would have made a reproduced cell fail: each change is made, and the cell fails."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from replication import characteristic, datasets, published
from replication.simulator import growth
from replication.simulator.parameters import identified_joint, with_ratios
from replication.studies import bounds, inspection
from replication.workbook import basis, judging

TABLE1 = published.cells("Table 1").index


def verdict(cell, reproduced, source="authors", **region):
    found = pd.DataFrame([{"id": cell, "source": source, "reproduced": reproduced, "notebook": "n"} | region])
    return judging.judge(found).iloc[0]["verdict"]


def test_every_basis_of_evidence_names_a_change_and_the_test_that_makes_it():
    table = published.basis()
    evidence = table[table["basis"] == "evidence"]
    assert (evidence["fails_if"] != "").all()
    here = {f"tests/workbook/test_evidence.py::{name}" for name in globals() if name.startswith("test_")}
    assert set(evidence["test"]) <= here


def test_every_verdict_by_evidence_says_what_would_have_made_it_fail():
    table = pd.read_csv(judging.ROOT / "results" / "verdicts.csv", keep_default_na=False)
    assert (table.loc[table["verdict"].isin(judging.EVIDENCE), "fails_if"] != "").all()
    for row in table.to_dict("records"):
        basis.of(row["id"], row["source"])


def test_another_turn_period_in_the_data_is_neither_printed_nor_corrected(record_12):
    slower = replace(record_12, t=1.05 * record_12.t)
    tried = pd.DataFrame(columns=["cell", "shift", "bound", "replayed"])
    for cell, value in bounds.table1_cells(slower, tried).items():
        assert verdict(cell, value) == "differs"


@pytest.mark.parametrize("cell", [cell for cell in TABLE1 if cell.split(".")[1] not in ("A", "T_d", "T_f")])
def test_a_bound_that_is_off_loses_the_stored_first_generations(record_12, cell):
    tried = pd.DataFrame({"cell": cell, "shift": bounds.SHIFTS})
    printed = published.value(cell)
    lower, upper = (published.value(f"{cell.rpartition('.')[0]}.{side}") for side in ("min", "max"))
    t, v, name = record_12.t, record_12.v, cell.split(".")[1]
    scale, offset = {"t0": (np.ptp(t), t[0]), "v_t": (np.ptp(v), v.min())}.get(name, (1.0, 0.0))
    places = offset + scale * (printed + (upper - lower) * tried["shift"])
    for best, expected in ((0.0, "reproduced"), (0.1, "differs")):
        counts = np.where(tried["shift"] == best, 30, 1)
        value = bounds.table1_cells(record_12, tried.assign(bound=places, replayed=counts))[cell]
        assert verdict(cell, value) == expected


def test_another_joint_has_other_peaks():
    joint = identified_joint()
    levels = list(growth.printed_amplitudes())
    ours = growth.amplitudes(joint, levels)["amplitude_rps"]
    softer = with_ratios(joint, {"stiffness_per_s2": 0.8 * joint.ratios["stiffness_per_s2"]})
    softer = growth.amplitudes(softer, levels)["amplitude_rps"]
    for row, (peak, other) in enumerate(zip(ours, softer, strict=True), start=1):
        assert verdict(f"table2.row{row:02d}.theoretical", peak, "simulated") == "reproduced"
        assert verdict(f"table2.row{row:02d}.theoretical", other, "simulated") == "differs"


def test_another_joint_has_another_characteristic():
    delta = characteristic.printed_levels_rad()
    peaks = growth.amplitudes(identified_joint(), delta)["amplitude_rps"].to_numpy()
    fitted = characteristic.fit_characteristic(peaks, delta)  # of a joint whose peaks are within 1 % of the printed
    for k in range(4):
        assert verdict(f"equation10.A{k}", 1e6 * fitted.coefficients[k], "simulated") == "differs"


def test_another_noise_in_the_records_is_noticed(authors_data, monkeypatch):
    loaded = inspection.load_noisy

    def louder(level, realisation):
        record = loaded(level, realisation)
        clean = 100.0 if level < 3 else datasets.load_clean(level).v
        return replace(record, v=clean + 1.1 * (record.v - clean))

    monkeypatch.setattr(inspection, "load_noisy", louder)
    for row, amplitude in enumerate(inspection.noise_amplitudes(), start=1):
        assert verdict(f"table2.row{row:02d}.noise", amplitude) == "differs"


@pytest.mark.parametrize("row", range(1, 11))
def test_another_amplitude_is_outside_the_region_of_a_mean(row):
    regions = pd.read_csv(judging.ROOT / "results" / "verdicts.csv").set_index(["id", "source"])
    region = regions.loc[(f"table2.row{row:02d}.mean", "authors"), ["low", "high"]].to_dict()
    printed = published.value(f"table2.row{row:02d}.mean")
    wrong = printed * 1.3
    moved = {name: bound + wrong - printed for name, bound in region.items()}
    assert verdict(f"table2.row{row:02d}.mean", wrong, **moved) == "differs"


def test_another_share_of_strays_is_outside_the_region_of_an_sd():
    printed = published.value("table2.row02.sd")
    assert verdict("table2.row02.sd", 0.05, low=0.02, high=0.09) == "differs"
    assert verdict("table2.row02.sd", printed, low=0.5 * printed, high=2 * printed) == "reproduced"


def test_another_rmse_of_equation_10_is_no_erratum():
    delta = characteristic.printed_levels_rad()
    theoretical = published.column("Table 2", "theoretical")[: delta.size]
    fitted = characteristic.fit_characteristic(theoretical, delta)
    assert verdict("equation10.rmse", fitted.rmse_rad) == "erratum"
    moved = np.where(np.arange(delta.size) == 4, 1.01 * theoretical, theoretical)
    assert verdict("equation10.rmse", characteristic.fit_characteristic(moved, delta).rmse_rad) == "differs"


def test_another_speed_or_number_of_turns_is_noticed(record_12):
    assert verdict("text.commanded_speed", float(np.median(1.01 * record_12.v))) == "differs"
    half = replace(record_12, t=record_12.t[:1201], v=record_12.v[:1201])
    counts = bounds.turns_by_replay(half, range(5, 9))
    assert (counts == 0).all()
    assert verdict("text.turns", round(np.ptp(half.t) / half.turn_period_s)) == "differs"


def test_a_worse_mean_breaks_the_limit_on_errors():
    assert verdict("text.error_limit_percent", 10.5) == "differs"
    assert verdict("text.error_limit_percent", 9.5) == "reproduced"
