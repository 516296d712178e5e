"""The replication article: it is typeset from the results, and no place in it is empty."""

import json
import re

import pandas as pd
import pytest
import yaml
from derived import derived, says
from places import RESULTS

import workbook
from replication import published
from workbook import judging
from workbook.report import article, facts
from workbook.report.cells import SIGNS

typst = pytest.importorskip("typst", reason="typst is not installed (extra `article`)")
TEXT = (workbook.ROOT / "article" / "article.typ").read_text(encoding="utf-8")
NAMED = re.compile(r'\b(?:n|w|W|be|[aA]ll-of)\("(\w+)"')


@pytest.mark.slow
def test_the_article_is_typeset_the_same_each_time():
    pdf = article.typeset(RESULTS)
    assert pdf.startswith(b"%PDF")
    assert article.typeset(RESULTS) == pdf


def test_the_committed_article_is_what_the_results_give():
    assert (RESULTS / "article.pdf").read_bytes() == article.typeset(RESULTS), "run: make article"


def test_every_number_that_the_text_names_is_in_the_results():
    named = set(NAMED.findall(TEXT))
    found = facts.collect_facts(RESULTS, judging.verdicts(RESULTS))
    assert len(named) > 25
    assert not {name for name in named if not found.get(name)}


@pytest.mark.slow
def test_every_number_of_the_article_is_what_the_results_give_when_it_is_derived_anew():
    found, anew = facts.collect_facts(RESULTS, judging.verdicts(RESULTS)), derived()
    named = set(NAMED.findall(TEXT))
    assert not named - anew.keys(), "a number without a derivation of its own"
    for name in sorted(named):
        value = anew[name]
        assert found[name].startswith(value) if isinstance(value, str) else says(found[name], value), name


def test_a_number_that_is_off_in_its_last_digit_is_not_what_a_text_says():
    assert says("5.93·10⁻⁶", 5.934e-6)
    assert not says("5.93·10⁻⁶", 5.941e-6)
    assert says("10⁵", 1e5)
    assert not says("12.3", 12.36)
    assert not says("7", 8)


@pytest.mark.slow
def test_a_number_that_is_not_there_stops_the_typesetting(monkeypatch):
    whole = article.collect_content(RESULTS)
    empty = whole["facts"] | {"best_worst_high": ""}
    monkeypatch.setattr(article, "collect_content", lambda _: whole | {"facts": empty})
    with pytest.raises(article.NotTypeset, match="best_worst_high"):
        article.typeset(RESULTS)
    short = {name: value for name, value in whole["facts"].items() if name != "printed"}
    monkeypatch.setattr(article, "collect_content", lambda _: whole | {"facts": short})
    with pytest.raises(article.NotTypeset, match="printed"):
        article.typeset(RESULTS)


def test_no_number_with_decimals_is_typed_in_the_text():
    prose = TEXT[TEXT.index("*Abstract.*") :]
    prose = re.sub(r'#n\("\w+"\)|#figure\(.*?\n\) <\w+>', "", prose, flags=re.DOTALL)
    assert not re.findall(r"\d+\.\d+", prose)


def test_the_finding_names_the_protocols_that_explain_the_table():
    judged = pd.DataFrame({"p": [0.4, 0.2, 0.01], "explains": [True, True, False]}, index=["a", "b", "c"])
    said = facts.describe_protocols(judged)
    assert said.startswith("2 of 3 candidate protocols are compatible with Table 2: a (p = 0.4), b")
    assert "cannot tell them apart" in said
    assert "The next, c, fails with p = 0.01." in said
    none = facts.describe_protocols(judged.iloc[2:])
    assert none.startswith("None of 1 candidate protocols are compatible with Table 2. The next, c, fails")


def test_what_the_text_says_of_single_protocols_is_what_the_table_has():
    table = pd.read_csv(RESULTS / "protocols.csv").sort_values("p", ascending=False).reset_index(drop=True)
    assert list(table["explains"]) == [True, True] + [False] * (len(table) - 2)
    assert table.loc[2, "protocol"] == "authors' notebook", "the candidate that just fails"
    assert 0.03 < table.loc[2, "p"] < 0.05
    assert table.loc[0, "sds_outside"] == 0, "the SDs differ under the notebook's settings only"


def test_the_theoretical_amplitudes_are_all_that_our_simulator_reproduces():
    decided = judging.deciding(judging.verdicts(RESULTS)).query("verdict == 'reproduced' and source == 'simulated'")
    assert set(decided["id"].str.split(".").str[-1]) == {"theoretical"}


def test_tables_and_captions_have_no_empty_place():
    found = article.collect_content(RESULTS)
    assert len(found["claims"]) == len(published.claims())
    assert len(found["errata"]) == len(published.errata())
    for rows in ("claims", "errata"):
        for row in found[rows]:
            assert all(str(value).strip() for name, value in row.items() if name != "measured"), row
    assert len(found["open"]) >= 2


def test_the_papers_four_tables_stand_whole_beside_ours():
    tables = article.collect_content(RESULTS)["tables"]
    for element, cells in published.cells().groupby("element"):
        if element.startswith("Table "):
            beside = [each for row in tables[element] for each in row.values() if isinstance(each, dict)]
            assert sorted(each["printed"] for each in beside) == sorted(cells["printed"])
            assert all(each["sign"] for each in beside)
    stand_ins = [row for element in ("Table 3", "Table 4") for row in tables[element]]
    assert {row[name]["sign"] for row in stand_ins for name in ("mean", "sd")} == {SIGNS["stand-in"]}
    assert all(row["means"] and row["region"] and row["sds"] for row in tables["Table 2"])


def test_what_the_article_quotes_is_in_the_reference_list_with_its_place():
    listed = yaml.safe_load((workbook.ROOT / "article" / "references.yml").read_text(encoding="utf-8"))
    cited = set(re.findall(r"@([a-z\d-]+)", TEXT)) - set(re.findall(r"<([a-z\d-]+)>", TEXT))
    assert cited == set(listed)
    assert len(listed) >= 15
    for name, entry in listed.items():
        assert {"title", "author", "date"} <= set(entry), name
        if entry.get("parent", {}).get("type") == "periodical":
            assert "volume" in entry["parent"], name


def test_each_proof_of_an_erratum_is_a_test_that_exists():
    for row in article.collect_content(RESULTS)["errata"]:
        file, name = row["evidence"].split("::")
        assert f"def {name}(" in (workbook.ROOT / file).read_text(encoding="utf-8")


def test_no_label_of_a_figure_is_smaller_than_7_pt():
    drawn = json.loads(
        typst.query(
            str(article.SOURCE),
            "<drawing>",
            field="value",
            root=str(workbook.ROOT),
            sys_inputs={"data": json.dumps(article.collect_content(RESULTS))},
        )
    )
    assert len(drawn) >= 5
    assert not [each["name"] for each in drawn if each["smallest"] < 7 - 1e-6]
