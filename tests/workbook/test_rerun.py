"""Making one result again."""

import json

import pytest

import workbook
from workbook import execution, judging, running
from workbook.__main__ import main

RESULTS = workbook.ROOT / "results"
MEAN = "table2.row03.mean"


@pytest.mark.slow
def test_a_claim_made_again_is_what_the_results_say_and_the_results_stay(capsys):
    before = (RESULTS / "outcomes" / "02_dead_zone_figure9.json").read_bytes()
    claims = judging.decided_claims(RESULTS)
    claim = claims[claims["notebook"] == "02_dead_zone_figure9"].iloc[0]
    table = running.rerun(claim["id"], RESULTS)
    assert (
        table["reproduced_now"].tolist()
        == table["reproduced_before"].tolist()
        == [claim["measured"]]
    )
    assert (RESULTS / "outcomes" / "02_dead_zone_figure9.json").read_bytes() == before


@pytest.fixture
def another_mean(monkeypatch):
    """Notebook 8 as it would be if it found another mean."""

    def execute(source, destination):
        outcome = json.loads(
            (RESULTS / "outcomes" / f"{source.stem}.json").read_text(encoding="utf-8")
        )
        for row in outcome["cells"]:
            if row["id"] == MEAN:
                row["numbers"] = [1.5 * number for number in row["numbers"]]
        folder = destination / "results" / "outcomes"
        folder.mkdir(parents=True)
        (folder / f"{source.stem}.json").write_text(json.dumps(outcome), encoding="utf-8")

    monkeypatch.setattr(execution, "execute", execute)


@pytest.mark.slow
def test_a_number_that_comes_out_otherwise_stands_beside_the_one_before(another_mean, capsys):
    assert main(["show", MEAN, "--rerun"]) == 0
    said = capsys.readouterr().out
    table = running.rerun(MEAN.upper(), RESULTS)
    made = table[table["source"] == "authors"].iloc[0]
    assert made["reproduced_now"] == pytest.approx(1.5 * made["reproduced_before"], rel=1e-5)
    assert f"{made['reproduced_now']:.4g}"[:5] in said


@pytest.mark.slow
def test_what_no_notebook_makes_is_said_in_one_line(capsys):
    assert main(["show", "text.encoder_bits", "--rerun"]) == 2
    assert capsys.readouterr().err == "text.encoder_bits: no notebook makes it\n"
