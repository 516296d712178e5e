"""Verdicts: a printed number agrees while ours and it are close, and both can end that."""

import math

import numpy as np
import pandas as pd
import pytest

from replication import published, table2
from replication.files import UserError
from workbook import judging
from workbook.outcomes import cell_rows, load_outcomes
from workbook.project import RESULTS

CELLS = published.cells()
EXPORTED = judging.collect("cells", ["numbers"])["numbers"]
TESTED = [*CELLS.index[~CELLS["source"].isin(judging.NOT_TESTED)]]
# Tested only in the sense that the printed bound could be too low: it has no upper end.
BOUNDS = {*CELLS.index[CELLS["kind"] == "bound"]}


def judged(cell, numbers):
    ours = pd.DataFrame(cell_rows({cell: numbers})).set_index("id")
    return judging.judge_numbers(ours).loc[cell]


def tolerance_of(cell):
    return CELLS.at[cell, "abs_tol"] + CELLS.at[cell, "rel_tol"] * abs(CELLS.at[cell, "value"])


def agreement(cell, numbers):
    return judged(cell, numbers)["agreement"]


def forty(value, spread=0.02):
    """Forty realisations about a value, up to a share of it away."""
    return [*np.linspace((1 - spread) * value, (1 + spread) * value, 40)]


# ------------------------------------------------------------------------------------------------ the rule


def test_a_value_within_its_tolerance_agrees_and_one_beyond_differs():
    cell = "table2.row03.noise"
    value, tolerance = published.value(cell), tolerance_of(cell)
    for off, expected in ((0.99, "agrees"), (1.01, "differs"), (-1.01, "differs")):
        assert agreement(cell, value + off * tolerance) == expected


def test_all_settings_together_give_one_interval_and_each_is_counted_alone():
    printed = published.value("table2.row02.mean")
    row = judged("table2.row02.mean", {"near": forty(printed), "far": forty(1.1 * printed)})
    assert row["agreement"] == "agrees"
    assert "under 1 of 2 settings alone" in row["reason"]
    assert row["low"] < printed < row["high"]
    assert row["high"] > 1.1 * printed
    assert agreement("table2.row02.mean", {"far": forty(1.1 * printed)}) == "differs"


@pytest.mark.parametrize(("size", "verdict"), [(38, "not tested"), (39, "agrees")])
def test_too_few_realisations_test_nothing(size, verdict):
    assert agreement("table2.row02.mean", {"a": forty(0.387)[:size]}) == verdict


@pytest.mark.parametrize("name", ["04_growth_figure11", "09_stand_ins_tables3_4"])
@pytest.mark.parametrize(
    "more", [lambda row: [], lambda row: [row | {"numbers": math.inf}]], ids=["none", "infinite"]
)
def test_a_number_that_is_missing_is_refused_that_of_a_stand_in_too(name, more, monkeypatch):
    outcomes = load_outcomes()
    row = outcomes[name]["cells"].pop(0)
    outcomes[name]["cells"] += more(row)
    monkeypatch.setattr(judging, "load_outcomes", lambda: outcomes)
    with pytest.raises(UserError, match=rf"{row['id']}: no notebook has computed it; make all"):
        judging.verdicts()


# ------------------------------------------------------------------- every number can end its agreement


@pytest.mark.parametrize("cell", TESTED)
def test_another_number_of_ours_changes_the_verdict(cell):
    """Ours is moved until the printed number lies beyond its interval, on either side; a bound only upwards."""
    numbers, printed = EXPORTED[cell], published.value(cell)
    low, ours, high = judged(cell, numbers)[["low", "reproduced", "high"]]
    over = 0.1 * (ours - low) + 2e-5 * max(abs(printed), 1e-9)
    up, down = printed - low + over, printed - high - over
    for shift in [up] if cell in BOUNDS else [up, down]:
        if isinstance(numbers, dict):
            moved = {name: [x + shift for x in of] for name, of in numbers.items()}
        else:
            moved = numbers + shift
        assert agreement(cell, moved) == "differs"


def test_agreement_is_weak_where_a_third_more_or_less_would_agree_too():
    cell, printed = "table2.row02.mean", published.value("table2.row02.mean")
    for spread, grade in ((0.3, "agrees"), (0.36, "agrees weakly")):
        row = judged(cell, {"a": forty(printed, spread)})
        assert (row["agreement"], row["grade"]) == ("agrees", grade)
    assert judged(cell, {"a": forty(3 * printed, 0.2)})["grade"] == "differs"


def test_an_outside_recount_of_table_2_moves_no_cell():
    """Plain pandas: of the sorted numbers of all settings with the whole record the k-th from either end."""
    study = pd.read_csv(RESULTS / "table2_realisations.csv")
    table = judging.verdicts()
    study = study[study["protocol"].isin([settings.name for settings in table2.SETTINGS])]
    for row, part in study.groupby("row"):
        for of in ("mean", "sd"):
            ranked = part[f"{of}_A_rps"].sort_values().to_numpy()
            k = (ranked.size + 1) // 40  # 2.5 % at either end
            kept = table.loc[f"table2.row{row:02d}.{of}"]
            low, high = ranked[k - 1], ranked[-k]
            assert kept[["low", "high"]].tolist() == pytest.approx([low, high], rel=1e-5)
            assert (kept["agreement"] == "agrees") == (low <= kept["published"] <= high)


def test_what_is_not_tested_is_a_stand_in_or_taken_over_and_says_so_whatever_its_number():
    for cell in CELLS.index.difference(TESTED):
        assert CELLS.loc[cell, "reason"] != ""
        ours = {"source": ["recomputed"], "numbers": 2 * published.value(cell) + 1}
        verdict = judging.judge_numbers(pd.DataFrame(ours, [cell])).loc[cell]
        assert verdict["agreement"] == "not tested"


# ---------------------------------------------------------------------------------------------- the claims' rules

LESS, MORE = 3 * (1 - 1e-12), 3 * (1 + 1e-12)
# Of each rule, its limit and what it tells of measured numbers; None is undecided.
TOLD = [
    ("below", 3.0, {2.9: True, LESS: False, MORE: False}),
    ("at most", 3.0, {LESS: True, MORE: True, 3.0001: False}),
    ("above", 3.0, {3.1: True, LESS: False, MORE: False}),
    ("at least", 3.0, {LESS: True, MORE: True, 2.9: False}),
    ("rounds to", 4e-4, {4.49e-4: True, 4.51e-4: False, 3.51e-4: True, 3.49e-4: False}),
    ("rounds to, or a bound", 4e-4, {4.49e-4: True, 4.51e-4: False, 3.49e-4: None}),
    ("interval below", 3.0, {(1.0, 2.9): True, (3.1, 4.0): False, (2.0, 4.0): None}),
    ("interval above", 3.0, {(3.1, 4.0): True, (1.0, 2.9): False, (2.0, 4.0): None}),
    ("p below", 0.05, {(0.01, 0.99): True, (0.99, 0.01): False, (0.2, 0.8): None}),
]


@pytest.mark.parametrize(("name", "limit", "decided"), TOLD)
def test_every_rule_tells_what_holds_from_what_does_not_and_last_bits_decide_nothing(
    monkeypatch, name, limit, decided
):
    table = published.table("claims")
    table.loc["monotone", ["rule", "criterion"]] = name, limit
    monkeypatch.setattr(judging, "read_table", lambda asked: table)
    assert {measured: judging.decide("monotone", measured) for measured in decided} == decided
    numbers = np.size(next(iter(decided)))
    assert judging.decide("monotone", (np.nan,) * numbers) is None
    with pytest.raises(ValueError, match="monotone"):
        judging.decide("monotone", (1.0,) * (3 - numbers))


def test_another_limit_can_be_tried():
    assert judging.decide("half_turn", 0.04) is True
    assert judging.decide("half_turn", 0.04, {"half_turn": 0.03}) is False


# ------------------------------------------------------------------------------- the results that are there


def test_on_our_own_records_the_source_is_our_joint(monkeypatch):
    monkeypatch.setenv("BACKLASH_RECORDS", "simulated")
    cells = ["table2.row05.mean", "text.runs", "text.load"]
    sources = [row["source"] for row in cell_rows(dict.fromkeys(cells, 1.0))]
    assert sources == ["simulated joint", "simulated joint", "taken over"]


def test_a_claim_that_no_notebook_can_decide_says_why_and_another_is_refused(monkeypatch):
    claim = judging.claims().loc["static_reference"]
    assert claim["verdict"] == "undecided"
    assert claim["measured"] == "the static measures are not printed"
    monkeypatch.setattr(judging, "load_outcomes", dict)
    with pytest.raises(UserError, match="no notebook has decided it; make all"):
        judging.claims()


@pytest.mark.parametrize("judge", [judging.verdicts, judging.claims])
def test_a_notebook_s_outcome_in_the_place_of_another_s_is_refused(judge, monkeypatch):
    outcomes = load_outcomes()
    outcomes["05_signature_figure6"] = outcomes["04_growth_figure11"]
    monkeypatch.setattr(judging, "load_outcomes", lambda: outcomes)
    with pytest.raises(UserError, match=r"exported by two notebooks, 04_growth_figure11 and 05_"):
        judge()


def test_numbers_and_sentences_are_shown_in_two_tables_without_ids_and_with_one_digit_more():
    cells = {"table2.row01.relative_error": 1 / 3, "table2.row02.mean": 0.4, "text.turns": 12}
    claims = {"local_minima": ((math.nan, 1.0), "80 % of the runs")}
    shown, sentences = judging.compare(cells, claims)
    assert [*shown["number"][:2]] == ["Table 2, row 1, relative error", "Table 2, row 2, mean"]
    assert [*shown["ours"]] == ["0.333", "0.40000", "12.0"]
    name, measured, committed, verdict = sentences.loc["local_minima"]
    assert (name, measured, verdict) == ("local minima", "80 % of the runs", "undecided")
    assert committed == judging.claims().at["local_minima", "measured"]
