"""The replication article: it is typeset from the results, and no place in it is empty."""

import re

import pandas as pd
import pytest
from derived import derived, says
from places import RESULTS

from replication import published, workbook
from replication.report import article, facts
from replication.workbook import judging

typst = pytest.importorskip("typst", reason="typst is not installed (extra `article`)")
TEXT = (workbook.ROOT / "article" / "article.typ").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_article_is_typeset_the_same_each_time():
    pdf = article.typeset(RESULTS)
    assert pdf.startswith(b"%PDF")
    assert article.typeset(RESULTS) == pdf


def test_the_committed_article_is_what_the_results_give():
    assert (RESULTS / "article.pdf").read_bytes() == article.typeset(RESULTS), "run: make article"


def test_every_number_that_the_text_names_is_in_the_results():
    named = set(re.findall(r'#n\("(\w+)"\)', TEXT))
    found = facts.collect_facts(RESULTS, judging.verdicts(RESULTS))
    assert len(named) > 25
    assert not {name for name in named if not found.get(name)}


@pytest.mark.slow
def test_every_number_of_the_article_is_what_the_results_give_when_it_is_derived_anew():
    found, anew = facts.collect_facts(RESULTS, judging.verdicts(RESULTS)), derived()
    named = set(re.findall(r'#n\("(\w+)"\)', TEXT))
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
    assert said.startswith("2 of 3 candidate protocols can have printed Table 2: a (p = 0.4), b")
    assert "cannot tell them apart" in said
    assert facts.describe_protocols(judged.iloc[2:]) == "None of 1 candidate protocols can have printed Table 2."


def test_tables_and_captions_have_no_empty_place():
    found = article.collect_content(RESULTS)
    assert len(found["table2"]) == 10
    assert len(found["claims"]) == len(published.claims())
    assert len(found["errata"]) == len(published.errata())
    for rows in ("table2", "claims", "errata"):
        for row in found[rows]:
            assert all(str(value).strip() for name, value in row.items() if name != "measured"), row
    assert len(found["open"]) >= 2
