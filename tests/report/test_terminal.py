"""The commands `check` and `show`."""

from replication import published
from workbook.__main__ import main


def test_check_ends_well_and_prints_every_compared_number(verdicts, capsys):
    assert main(["check"]) == 0
    said = capsys.readouterr().out
    taken = verdicts.query("source == 'taken over' and id.str.startswith('text')")["id"]
    assert [text for text in published.cells().drop(taken)["printed"] if text not in said] == []
    row = verdicts.set_index("id").loc["table2.row03.mean"]
    assert f"{row['low']:.4f} to {row['high']:.4f}" in said


def test_check_fails_if_a_cell_differs_and_is_not_a_known_difference(replace_table, capsys):
    cells = published.cells()
    known = cells.index[cells["known_difference"] != ""][0]
    replace_table("cells", cells.assign(known_difference=""))
    assert main(["check"]) == 1
    assert f"{known} differs" in capsys.readouterr().out


def test_show_tells_of_a_cell_what_is_printed_ours_and_the_verdict(verdicts, capsys):
    assert main(["show", "Table 2.row3.SD"]) == 0
    said = capsys.readouterr().out
    row = verdicts.set_index("id").loc["table2.row03.sd"]
    for part in ("0.0138 rps", "weakly agrees", f"{row['reproduced']:.4f}"):
        assert part in said


def test_show_of_an_unknown_name_says_what_is_near_in_one_line(capsys):
    assert main(["show", "row03.sd"]) == 2
    said = capsys.readouterr().err.strip()
    assert "table2.row03.sd" in said
    assert "\n" not in said
