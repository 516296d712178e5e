"""Facts: what texts name in braces comes from the notebooks and the verdicts, and moves with them."""

import json
import re
import shutil
from collections import Counter

import numpy as np
import pandas as pd
import pytest

import workbook
from replication import published
from workbook import judging, outcomes
from workbook.checkout import RESULTS
from workbook.report import article, facts, markdown

VERDICTS = judging.verdicts(RESULTS)
ARTICLE = article.SOURCE.read_text("utf-8")
IN_BRACES = re.compile(r"\{(\w+)\}")
IN_ARTICLE = re.compile(r'\b(?:n|w|W|be|count|[aA]ll-of)\("(\w+)"|\bout-of\("(\w+)", "(\w+)"')
IN_TEMPLATE = re.compile(r"facts\.(\w+)")


def named():
    """Every name of a fact in a text."""
    data = [
        published.table("findings")["text"],
        published.table("errata")["computed"],
        published.table("trail")["counts"],
        published.cells()["reason"],
    ]
    found = {name for texts in data for text in texts for name in IN_BRACES.findall(text)}
    for file in (workbook.ROOT / "workbook" / "report" / "templates").glob("*.j2"):
        found |= set(IN_TEMPLATE.findall(file.read_text("utf-8")))
    return found | {name for names in IN_ARTICLE.findall(ARTICLE) for name in names if name}


def test_every_name_in_a_text_is_a_fact():
    found = facts.collect_facts(RESULTS, VERDICTS)
    assert len(named()) > 100
    assert {name for name in named() if not found.get(name)} == set()


def test_every_fact_is_named_in_a_text_and_exported_by_one_notebook():
    exported = Counter(
        name for outcome in outcomes.load_outcomes(RESULTS).values() for name in outcome["facts"]
    )
    assert set(exported) - named() == set()
    assert set(exported.values()) == {1}
    counted = facts.count_verdicts(VERDICTS, judging.decided_claims(RESULTS))
    assert set(exported) & set(counted) == set()


def test_a_fact_that_moves_moves_the_texts(tmp_path):
    shutil.copytree(RESULTS / "outcomes", tmp_path / "outcomes")
    file = tmp_path / "outcomes" / "18_the_stored_runs.json"
    outcome = json.loads(file.read_text("utf-8"))
    outcome["facts"] |= {"replayed": "1234", "replay_apart": "7e-08"}
    file.write_text(json.dumps(outcome), encoding="utf-8")
    content = article.collect_content(tmp_path)["facts"]
    said = " ".join(each["text"] for each in facts.fill_in_findings(content))
    assert (content["replayed"], content["replay_apart"]) == ("1234", "7·10⁻⁸")
    assert "1234 of 30 stored runs end at the stored misfit, within 7·10⁻⁸ rps" in said


def test_a_verdict_that_moves_moves_the_counts_in_the_readme_and_the_texts(tmp_path):
    shutil.copytree(RESULTS / "outcomes", tmp_path / "outcomes")
    before = facts.collect_facts(tmp_path, VERDICTS)
    file = tmp_path / "outcomes" / "06_characteristic_figure12.json"
    outcome = json.loads(file.read_text("utf-8"))
    next(row for row in outcome["cells"] if row["id"] == "equation10.A2")["numbers"] = 1.0
    file.write_text(json.dumps(outcome), encoding="utf-8")
    after = facts.collect_facts(tmp_path, judging.verdicts(tmp_path))
    assert int(after["differs"]) == int(before["differs"]) + 1
    assert int(after["equation10_agrees"]) == int(before["equation10_agrees"]) - 1
    assert markdown.render_status(tmp_path) != markdown.render_status(RESULTS)


def test_printed_numbers_are_counted_by_source_element_and_column():
    rows = [
        ("table2.row02.mean", "recomputed", "differs", 0.04),
        ("table2.row03.sd", "recomputed", "agrees", 8.0),
        ("table2.row03.theoretical", "authors' files", "agrees", 0.025),
        ("table4.row01.mean", "stand-in", "not tested", 0.1),
    ]
    verdicts = pd.DataFrame(rows, columns=["id", "source", "agreement", "resolution"])
    claims = pd.DataFrame(
        {
            "id": ["local_minima", "random_start", "two_impacts"],
            "verdict": ["holds", "does not hold", "holds"],
        }
    )
    found = facts.count_verdicts(verdicts, claims)
    expected = {
        "printed": 4,
        "differs": 1,
        "agrees": 2,
        "weak": 1,
        "not_tested": 1,
        "recomputed_agrees": 1,
        "authors_files_agrees": 1,
        "stand_in_not_tested": 1,
        "table2_differs": 1,
        "table2_mean_differs": 1,
        "table2_mean_agrees": 0,
        "table2_sd_weak": 1,
        "claims_holds": 2,
        "claims_does_not_hold": 1,
        "claims_answers_changed": 1,
        "claims_first_holds": 1,
        "claims_first_does_not_hold": 2,
        "claims_undecided": 0,
    }
    assert {name: found[name] for name in expected} == expected
    fixed = [found[f"claims_{word}"] for word in ("fixed", "committed", "changed")]
    assert sum(fixed) == found["claims"] == len(published.table("claims"))
    kinds = published.table("errata")["kind"].value_counts()
    assert found["errata_paper"] == kinds["paper"]
    assert found["errata_data"] == kinds["data"]


def test_a_notebooks_facts_are_texts_counts_and_numbers_in_their_format(tmp_path, monkeypatch):
    monkeypatch.setenv("REPLICATION_OUT", str(tmp_path))
    monkeypatch.setenv("REPLICATION_NOTEBOOK", "05_signature_figure6")
    workbook.export(
        facts={
            "text": "so",
            "count": np.int64(3),
            "number": (0.12345, ".2f"),
            "missing": (float("nan"), ".1f"),
            "range": (pd.Series([3.0, np.nan, 1.0]), ".0f"),
            "nothing": ([], ".0f"),
        }
    )
    exported = outcomes.load_outcomes(tmp_path / "results")["05_signature_figure6"]["facts"]
    assert exported == {
        "text": "so",
        "count": "3",
        "number": "0.12",
        "range_low": "1",
        "range_high": "3",
    }


def test_powers_of_ten_are_written_as_by_hand():
    assert facts.typeset_powers("5.93e-06 rad, 1e5 and 1e-09") == "5.93·10⁻⁶ rad, 10⁵ and 10⁻⁹"


@pytest.mark.parametrize(
    "text", [*published.table("findings")["text"], *published.table("errata")["computed"]]
)
def test_no_text_types_a_number_that_results_could_change(text):
    allowed = {
        "1",
        "2",
        "3",
        "4",
        "8",
        "9",
        "10",
        "13",
        "30",
        "2021",
    }  # names: R = 1, equation 10, Table 2, rows 2 to 9, 30 runs, the CMA-ES of 2021
    typed = re.findall(r"(?<![\w.{])\d+(?:\.\d+)?(?:e-?\d+)?(?![\w}])", IN_BRACES.sub("", text))
    assert set(typed) <= allowed


def test_no_number_with_decimals_is_typed_in_the_article():
    prose = ARTICLE[ARTICLE.index("*Abstract.*") :]
    prose = re.sub(r'#n\("\w+"\)|#figure\(.*?\n\) <\w+>', "", prose, flags=re.DOTALL)
    assert not re.findall(r"\d+\.\d+", prose)
