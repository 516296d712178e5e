import os
import re
from pathlib import Path

import numpy as np
import pytest

from replication import published
from replication.characteristic import equation_10, printed_rows
from replication.records import noise_half_amplitude_rps

ROWS = printed_rows()
ERRATA = published.table("errata")


def test_every_cell_has_a_tolerance_and_a_reason_for_it():
    cells = published.cells()
    assert cells.index.is_unique
    assert (cells["tol_reason"] != "").all()
    assert (cells[["abs_tol", "rel_tol"]] >= 0).all(axis=None)


def test_a_printed_number_is_its_value_and_no_tolerance_is_tighter_than_half_its_last_digit():
    cells = published.cells()
    numeric = cells[cells["printed"].str.fullmatch(r"-?[\d.]+(e-?\d+)?%?")]
    assert len(numeric) > 80
    for cell, row in numeric.iterrows():
        assert float(row["printed"].rstrip("%")) == row["value"], cell
        if row["kind"] != "bound" and row["value"] != 0:  # a printed zero is exact
            half = published.half_last_digit(row["printed"])
            tolerance = row["abs_tol"] + row["rel_tol"] * abs(row["value"])
            assert tolerance >= half * (1 - 1e-9), cell


def test_the_tables_have_as_many_cells_as_the_paper_prints():
    sizes = published.cells().groupby("element").size()
    expected = {"Table 1": 9 * 2, "Table 2": 10 * 5 + 4, "Table 3": 3 * 4, "Table 4": 2 * 2}
    assert sizes.drop("Text").to_dict() == expected | {"Equation 10": 5}


def plain(text):
    """A sentence, a formula or a row of a table without TeX, brackets and spaces."""
    text = re.sub(r"\n\n(?=[a-z])", " ", text)  # a sentence that goes on in the next column
    text = re.sub(r"\\frac\{(.+?)\}\{(.+?)\}", r"\1/\2", text.replace("v(t)", "v"))
    text = re.sub(r"\\cdot|\\text|no backlash|[\\$ ()]", "", text.replace("π", "pi"))
    return re.sub("[{}]", "", re.sub(r"(×|times)10\^\{-", "e-", text))


@pytest.fixture(scope="module")
def paper():
    """The paper, plain."""
    return plain(
        "".join(p.read_text("utf-8") for p in Path(os.environ["PAPER_TEXT"]).glob("*.txt"))
    )


def test_claims_and_numbers_of_the_text_are_quoted_from_the_paper(paper):
    for quoted in (published.table("claims"), published.cells("Text")):
        for name, quote in quoted["quote"].items():
            for part in quote.split(" … "):
                assert plain(part) in paper, name
    for cell, row in published.cells("Text").iterrows():
        assert row["printed"] in row["quote"], cell


def test_the_numbers_of_the_tables_and_of_equation_10_are_those_of_the_paper(paper):
    rows = paper.replace("\n", "\t\n\t")
    cells = published.cells()
    tables = cells[cells["element"].str.startswith("Table")]
    for row, part in tables.groupby(["element", "row"])["printed"]:
        assert plain("\t" + "\t".join(part) + "\t") in rows, row
    for number in cells.loc[cells["element"] == "Equation 10", "printed"]:
        assert number in rows


def test_equation_10_takes_rpm_not_rps():
    delta, amplitude, *_ = ROWS.to_numpy().T
    in_rpm, in_rps = (equation_10(amplitude / unit) for unit in (1, 60))
    assert np.abs(in_rpm - delta).max() == pytest.approx(1.8e-5, abs=0.05e-5)
    assert "1.8e-5 rad" in ERRATA["effect"]["E2"]
    assert in_rps.max() < 5e-5
    assert np.abs(in_rps - delta).min() > 2e-4


def test_the_printed_rmse_of_equation_10_is_no_rmse_in_rad():
    delta, amplitude, *_ = ROWS.to_numpy().T
    *_, (squares,), _, _, _ = np.polyfit(60 * amplitude, delta, 3, full=True)
    best_possible = np.sqrt(squares / 10)
    assert best_possible > 1000 * published.value("equation10.rmse")
    of_freedom = best_possible * np.sqrt(10 / (10 - 4))  # ten points; a cubic has four coefficients
    off = equation_10(amplitude) - delta
    corrected = ERRATA.loc["E2", "corrected"]
    for rmse in (best_possible, of_freedom, np.sqrt(np.mean(off**2))):
        assert f"{1e6 * rmse:.2f}e-6" in corrected


def test_equation_19_gives_the_printed_noise_amplitudes_for_no_a_min_and_delta_a():
    # Every A_min and dA is a straight line.
    line = np.polyval(np.polyfit(ROWS["theoretical"], ROWS["noise"], 1), ROWS["theoretical"])
    rounding = 0.5e-4
    assert (np.abs(line - ROWS["noise"]) > 5 * rounding).sum() >= 7
    in_the_number = np.polyval(np.polyfit(ROWS.index, ROWS["noise"], 1), ROWS.index)
    assert (np.abs(in_the_number - ROWS["noise"]) < 2 * rounding).all()


def test_the_noise_is_not_proportional_to_the_amplitude():
    ratio = (ROWS["noise"] / ROWS["theoretical"]).to_numpy()
    assert (np.diff(ratio) < 0).all()
    assert 100 * ratio[[0, -1]] == pytest.approx([39, 16], abs=0.5)
    # Row 1 has the level K = 2.
    np.testing.assert_allclose(ROWS["noise"], noise_half_amplitude_rps(1 + ROWS.index), atol=1e-4)


def test_the_printed_errors_in_rad_are_bounds_and_no_errors_of_table_2():
    """A tenth of the gap, 2 delta, rounds to the one at the largest backlash."""
    erratum = ERRATA.loc["E18"]
    small, large = ROWS["error_rad"].iloc[[0, -1]]
    assert large == ROWS["error_rad"].max()
    for printed, error in (("error_rad_small", small), ("error_rad_large", large)):
        times = published.value(f"text.{printed}") / error
        assert times > 2
        assert f"{times:.2g}" in erratum["effect"]
        assert f"{error:.1e}".replace("e-0", "e-") in erratum["corrected"]
    of_gap = 0.1 * 2 * ROWS["delta_rad"].iloc[-1]
    assert round(of_gap, 4) == published.value("text.error_rad_large")
    assert f"{of_gap:.1e}".replace("e-0", "e-") in erratum["effect"]


def test_v_t_is_bounded_in_table_1_and_identified_by_the_stored_runs():
    assert published.value("table1.v_t.min") < published.value("table1.v_t.max")
    identified = published.table("authors_notebook_runs")["c_rps"]
    assert identified.nunique() > 1
    assert identified.between(99.98, 100.02).all()


def test_every_erratum_names_a_test_and_cells_that_exist():
    tests = "".join(p.read_text("utf-8") for p in Path(__file__).parent.glob("test_*.py"))
    for key, proof in ERRATA["proof"].items():
        assert f"def {proof}(" in tests, key
    assert set(" ".join(ERRATA["cells"]).split()) <= {*published.cells().index}


# ---------------------------------------------------------------------------------------------- the claims' rules


def test_a_limit_that_the_text_prints_is_the_criterion():
    for claim in ("error_rad_small", "error_rad_large", "encoder_step"):
        assert published.criterion(claim) == published.value(f"text.{claim}")
    assert published.criterion("error_below_10") == published.value("text.error_limit_percent")


def test_every_claim_that_is_measured_says_what_is_measured_where_by_which_rule_and_why():
    claims = published.table("claims")
    assert set(claims["of"]) == {"paper", "method"}
    measured = claims[claims["untested"] == ""]
    assert (measured[["check", "settings", "rule", "criterion", "reason"]] != "").all(axis=None)
