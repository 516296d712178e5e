"""Making one result again."""

import json
import shutil

import pandas as pd
import pytest

import workbook
from replication.table2 import predictive_region
from studies.replay import cell, inspection, protocols
from workbook import execution, judging
from workbook.__main__ import main

RESULTS = workbook.ROOT / "results"
OF_CUBIC = "equation10.A2"


@pytest.mark.slow
def test_a_claim_made_again_is_what_the_results_say_and_the_results_stay(capsys):
    outcome = RESULTS / "outcomes" / "02_dead_zone_figure9.json"
    before = outcome.read_bytes()
    claims = judging.decided_claims(RESULTS)
    claim = claims[claims["notebook"] == outcome.stem].iloc[0]
    assert main(["show", claim["id"], "--rerun"]) == 0
    first, said = capsys.readouterr().out.split("\n", 1)
    assert outcome.stem in first
    assert " ".join(said.split()).count(claim["measured"]) == 2
    assert outcome.read_bytes() == before


def test_a_number_that_comes_out_otherwise_stands_below_the_one_before(monkeypatch, capsys):
    """Notebook 6 as it would be if it found another coefficient."""

    def execute(source, destination):
        shutil.copytree(RESULTS / "outcomes", destination / "results" / "outcomes")
        file = destination / "results" / "outcomes" / f"{source.stem}.json"
        outcome = json.loads(file.read_text("utf-8"))
        next(row for row in outcome["cells"] if row["id"] == OF_CUBIC)["numbers"] *= 1.5
        file.write_text(json.dumps(outcome), encoding="utf-8")

    monkeypatch.setattr(execution, "execute", execute)
    assert main(["show", OF_CUBIC, "--rerun"]) == 0
    before, now = capsys.readouterr().out.split("\n\n                Equation 10")
    number = judging.verdicts(RESULTS).set_index("id").loc[OF_CUBIC, "reproduced"]
    assert f"{number:.4f}" in before
    assert f"{1.5 * number:.4f}" in now
    assert now.rstrip().endswith(": different")


def test_a_mean_made_again_stands_beside_the_region_of_the_kept_ones(monkeypatch):
    made = [{"mean_A_rps": 0.1234 + number} for number in range(4)]
    monkeypatch.setattr(cell, "in_parallel", lambda *_: made)
    made_again = cell.make_cell(3, "mean")
    study = pd.read_csv(protocols.REALISATIONS)
    kept = study[(study["protocol"] == protocols.LEADER) & (study["row"] == 3)]["mean_A_rps"]
    assert (made_again["recomputed"], made_again["committed"]) == (0.1234, kept.iloc[0])
    assert "3.1234 rps" in made_again["beside"]["fresh"]
    low, high = predictive_region(kept)
    assert made_again["beside"]["their interval"].startswith(f"{low:.6g} to {high:.6g} rps")


def test_the_noise_is_read_again_from_the_records(authors_data, capsys):
    main(["show", "table2.row03.noise", "--rerun"])
    said = capsys.readouterr().out
    assert said.startswith("table2.row03.noise is made again by its row alone")
    noise = f"{inspection.noise_amplitudes()[2]:.6g}"
    assert said.rstrip().endswith(f"recomputed {noise}, committed {noise}: identical")


def test_what_no_notebook_makes_is_said_in_one_line(capsys):
    assert main(["show", "text.encoder_bits", "--rerun"]) == 2
    assert capsys.readouterr().err == "text.encoder_bits: no notebook makes it\n"
