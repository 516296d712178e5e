"""The commands `check` and `show`."""

import pandas as pd
import pytest

from replication import published
from workbook import judging
from workbook.__main__ import main
from workbook.checkout import RESULTS
from workbook.report import terminal

VERDICTS = judging.verdicts(RESULTS)


def test_check_prints_every_compared_number_and_counts_what_the_text_only_gives(capsys):
    main(["check"])
    said = capsys.readouterr().out
    given = VERDICTS.query("verdict == 'given' and id.str.startswith('text')")["id"]
    for printed in published.cells().drop(given)["printed"]:
        assert printed in said
    assert f"{len(given)} more numbers" in said
    assert "decided by evidence" in said
    assert "⇄" in said


def test_check_ends_well_when_only_known_differences_differ(monkeypatch, capsys):
    differs = VERDICTS[VERDICTS["verdict"] == "differs"]
    known = differs[["id", "source"]].assign(reason="known")
    monkeypatch.setattr(published, "known_differences", lambda: known)
    assert main(["check"]) == 0
    monkeypatch.setattr(published, "known_differences", lambda: known.iloc[1:])
    assert main(["check"]) == 1
    assert f"{known['id'].iloc[0]} ({known['source'].iloc[0]}) differs" in capsys.readouterr().out


def test_a_known_difference_that_is_gone_is_told_but_is_no_failure():
    known = pd.DataFrame({"id": ["table2.row03.mean"], "source": ["authors"], "reason": ["once"]})
    same = VERDICTS.assign(verdict="reproduced")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(published, "known_differences", lambda: known)
        new, (gone,) = terminal.find_surprises(same)
    assert new == []
    assert "no longer differs" in gone


def test_show_tells_of_a_cell_what_is_printed_ours_the_verdict_and_where_it_is_made(capsys):
    assert main(["show", "table2.row03.sd"]) == 0
    said = capsys.readouterr().out
    row = VERDICTS.set_index(["id", "source"]).loc[("table2.row03.sd", "authors")]
    for part in (
        "0.0138 rps",
        row["verdict"],
        f"{row['reproduced']:.5g}",
        "notebooks/08_noise_table2.py",
        "RERUN=1",
    ):
        assert part in said
    assert "results/pages/08_noise_table2.html#verdict" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["Table 2", "Table 2.row8.SD", "Equation 10", "local_minima", "e3", "text"]
)
def test_show_takes_elements_claims_and_errata_in_any_spelling(name, capsys):
    assert main(["show", name]) == 0
    assert len(capsys.readouterr().out) > 100


def test_show_of_an_unknown_name_says_what_is_near_in_one_line(capsys):
    assert main(["show", "row03.sd"]) == 2
    said = capsys.readouterr().err.strip()
    assert "table2.row03.sd" in said
    assert "\n" not in said
