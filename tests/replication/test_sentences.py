"""A claim's verdict moves when the number that decides it is moved."""

import numpy as np
import pytest

from replication import published, sentences, table2
from replication.joint import identified_joint
from replication.records import Recording

KEPT = table2.read_realisations()


def verdicts(measured):
    return {claim: holds for claim, (holds, _) in published.decide_all(measured).items()}


@pytest.fixture
def print_number(monkeypatch):
    """Print another number in a cell."""

    def give(cell, value):
        printed = published.cells()
        printed.loc[cell, "value"] = value
        elements = {None: printed} | dict([*printed.groupby("element", sort=False)])
        monkeypatch.setattr(published, "cells", lambda element=None: elements[element])

    return give


# -------------------------------------------------------------------------------------------------------- Table 2


def test_the_sentences_on_table_2():
    assert verdicts(sentences.measure_table2(KEPT)) == {
        "error_below_10": True,
        "error_below_10_method": False,
        "quality_decreases": True,
        "local_minima": None,
        "noise_proportional": False,
    }


def test_one_printed_error_above_ten_per_cent_ends_the_sentence_on_the_printed_table(print_number):
    print_number("table2.row04.mean", 0.5636)
    assert (
        verdicts({"error_below_10": sentences.measure_printed_errors()})["error_below_10"] is False
    )


def scale_errors(factor, row=slice(None)):
    """Our tables with the errors of a row, or of all, made larger or smaller."""
    theoretical = published.column("Table 2", "theoretical")[KEPT["row"] - 1]
    moved = theoretical + factor * (KEPT["mean_A_rps"] - theoretical)
    chosen = KEPT["row"].isin(range(1, 12) if row == slice(None) else [row])
    return KEPT.assign(mean_A_rps=KEPT["mean_A_rps"].where(~chosen, moved))


@pytest.mark.parametrize(
    ("claim", "tables", "holds"),
    [
        ("error_below_10_method", scale_errors(0.3), True),
        ("error_below_10_method", scale_errors(0.7), None),
        ("quality_decreases", scale_errors(0.05, row=10), False),
        ("quality_decreases", scale_errors(0.25, row=10), None),
        ("local_minima", KEPT.assign(best_basin_share=0.9), None),  # the stored runs remain
        ("local_minima", KEPT.assign(best_basin_share=0.3), False),
    ],
)
def test_a_sentence_on_our_tables_moves_with_their_numbers(claim, tables, holds):
    assert verdicts(sentences.measure_table2(tables))[claim] is holds


def test_the_stored_runs_decide_too_whether_local_minima_are_avoided(monkeypatch):
    runs = published.table("authors_notebook_runs").assign(final_rmse_rps=0.05)
    original = published.table
    monkeypatch.setattr(
        published, "table", lambda name: runs if name.startswith("authors") else original(name)
    )
    assert verdicts(sentences.measure_table2(KEPT))["local_minima"] is True


def test_a_noise_that_is_proportional_would_be_found_so(print_number):
    for row in range(1, 11):
        print_number(
            f"table2.row{row:02d}.noise", 0.2 * published.value(f"table2.row{row:02d}.theoretical")
        )
    assert verdicts({"noise_proportional": sentences.measure_noise_proportional()}) == {
        "noise_proportional": True
    }


# ----------------------------------------------------------------------------- equation 10, dead zone, disturbance


@pytest.mark.parametrize(
    ("cell", "value", "claim", "holds"),
    [
        ("table2.row10.mean", 1.0696, "error_rad_large", False),
        ("table2.row10.mean", 0.995, "error_rad_large", True),
        ("table2.row01.mean", 0.0, "error_rad_small", False),
        ("equation10.A2", -0.4, "monotone", False),
        ("text.encoder_bits", 16, "encoder_step", False),
    ],
)
def test_a_sentence_on_equation_10_moves_with_the_printed_number(
    print_number, cell, value, claim, holds
):
    before = verdicts(sentences.measure_equation_10())
    assert before == dict.fromkeys(sentences.OF_EQUATION_10, True) | {"error_rad_large": False}
    print_number(cell, value)
    assert verdicts(sentences.measure_equation_10())[claim] is holds


def test_equations_8_and_9_leave_stiffness_and_a_jump_and_another_stiffness_would_not(monkeypatch):
    printed = verdicts(sentences.measure_dead_zone(identified_joint()))
    assert printed == {"stiffness_zero_inside": False, "no_discontinuity": False}
    monkeypatch.setattr(sentences, "K_BL", lambda *_: 0.0)
    monkeypatch.setattr(sentences, "tau_l", lambda *_: 0.0)
    empty = verdicts(sentences.measure_dead_zone(identified_joint()))
    assert empty == {"stiffness_zero_inside": True, "no_discontinuity": True}


def ring(delta, sign=-1.0, growth=1.0):
    """A made record of twelve turns: one half turn, repeated with a sign, and a little larger each time."""
    t = np.arange(100) * 0.002
    half = delta * 1e3 * np.exp(-10 * t) * np.sin(150 * t)
    v = 100 + np.concatenate([sign**k * growth**k * half for k in range(24)])
    return Recording(0.002 * np.arange(v.size), v, 100.0, 0.4, "made")


@pytest.mark.parametrize(
    ("changes", "failing"),
    [
        ({}, set()),
        ({"sign": 1.0}, {"two_impacts", "half_turn"}),
        ({"growth": 1.01}, {"same_amplitude"}),
    ],
)
def test_the_sentences_on_the_disturbance_fail_for_records_that_contradict_them(changes, failing):
    records = {delta: ring(delta, **changes) for delta in (3e-4, 5e-4)}
    measured = sentences.measure_disturbance(sentences.measure_records(records))
    assert {claim for claim, holds in verdicts(measured).items() if not holds} == failing
    shrinking = sentences.measure_records(records).assign(peak_rps=[2.0, 1.0], rms_rps=[2.0, 1.0])
    assert verdicts(sentences.measure_disturbance(shrinking))["amplitude_grows"] is None


def test_public_files_of_a_bench_would_be_counted(monkeypatch):
    monkeypatch.setattr(
        sentences, "authors_checksums", lambda: {"Bench/log1.csv": "", "a.xlsx": ""}
    )
    assert sentences.measure_public_files()[0] == 1


def test_records_of_the_authors_hold_what_the_text_says_of_them(authors_data):
    from replication.records import CLEAN_LEVELS, load_clean_records

    measured = sentences.measure_disturbance(
        sentences.measure_records(load_clean_records(CLEAN_LEVELS))
    )
    assert set(verdicts(measured).values()) == {True}
