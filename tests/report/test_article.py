"""The replication article: it is typeset from the results, and no place in it is empty."""

import json
import re

import pandas as pd
import pytest
import yaml

import workbook
from replication import published
from workbook.checkout import RESULTS
from workbook.report import article
from workbook.report.cells import SIGNS

typst = pytest.importorskip("typst", reason="typst is not installed (extra `article`)")


@pytest.fixture(scope="module")
def content():
    """What the article takes from the committed results."""
    return article.collect_content(RESULTS)


@pytest.mark.slow
def test_the_article_is_typeset_the_same_each_time():
    pdf = article.typeset(RESULTS)
    assert pdf.startswith(b"%PDF")
    assert article.typeset(RESULTS) == pdf


def test_the_committed_article_is_what_the_results_give():
    assert (RESULTS / "article.pdf").read_bytes() == article.typeset(RESULTS), "run: make article"


@pytest.mark.slow
@pytest.mark.parametrize("changed", [{"best_worst_high": ""}, {"printed": None}])
def test_a_number_that_is_empty_or_not_there_stops_the_typesetting(changed, content, monkeypatch):
    (name,) = changed
    facts = {key: value for key, value in (content["facts"] | changed).items() if value is not None}
    monkeypatch.setattr(article, "collect_content", lambda _: content | {"facts": facts})
    with pytest.raises(article.NotTypeset, match=name):
        article.typeset(RESULTS)


def test_the_kinds_that_the_headlines_name_add_up_to_their_counts(content):
    kinds = {
        "reproduced": ("table2_mean", "table2_sd"),
        "traced": ("table1", "table2_noise", "table2_theoretical", "text"),
    }
    for word, of_word in kinds.items():
        counts = [int(content["facts"][f"{kind}_{word}"]) for kind in of_word]
        assert sum(counts) == int(content["facts"][word])


def test_a_final_article_names_every_blank_that_is_open(tmp_path, monkeypatch):
    file = tmp_path / "citation"
    file.write_text('name: "OPEN: a name"  # and "OPEN: a place"', "utf-8")
    monkeypatch.setattr(article, "WITH_BLANKS", (file,))
    with pytest.raises(article.NotTypeset, match=r"citation: a name; .*citation: a place$"):
        article.typeset(RESULTS, final=True)


def test_tables_and_captions_have_no_empty_place(content):
    assert len(content["claims"]) == len(published.claims())
    claims = pd.DataFrame(content["claims"])[["claim", "verdict", "decided_in"]]
    errata = published.errata()[["location", "as_printed", "corrected", "evidence"]]
    assert claims.ne("").all(axis=None)
    assert errata.ne("").all(axis=None)
    assert len(content["open"]) >= 2


def test_the_papers_four_tables_stand_whole_beside_ours(content):
    beside = pd.DataFrame(content["cells"])
    for element, cells in published.cells().groupby("element"):
        own = beside[beside["element"] == element]
        assert sorted(own["printed"]) == sorted(cells["printed"])
        assert own["verdict"].isin(SIGNS).all()
    stand_ins = beside.query("element in ('Table 3', 'Table 4') and column in ('mean', 'sd')")
    assert {*stand_ins["verdict"]} == {"stand-in"}


def test_the_ranges_of_table_2_are_those_of_its_realisations():
    ranges = json.loads((RESULTS / "pages" / "article.json").read_text("utf-8"))["table2"]
    table = pd.read_csv(RESULTS / "table2.csv")
    for row, part in table.groupby("row"):
        said = ranges[str(row)]
        assert said["means"] == f"{part['mean_A_rps'].min():.3f} to {part['mean_A_rps'].max():.3f}"
        assert (said["in_best"], said["runs"]) == (
            part["best_basin_runs"].sum(),
            part["runs"].sum(),
        )
    assert len(ranges) == 10


def test_what_the_article_quotes_is_in_the_reference_list_with_its_place():
    text = article.SOURCE.read_text("utf-8")
    references = workbook.ROOT / "article" / "references.yml"
    listed = yaml.safe_load(references.read_text("utf-8"))
    cited = set(re.findall(r"@([a-z\d-]+)", text)) - set(re.findall(r"<([a-z\d-]+)>", text))
    assert cited == set(listed)
    assert len(listed) >= 15
    for name, entry in listed.items():
        assert {"title", "author", "date"} <= set(entry), name
        if entry.get("parent", {}).get("type") == "periodical":
            assert "volume" in entry["parent"], name


def test_no_label_of_a_figure_is_smaller_than_7_pt(content):
    inputs = {"data": json.dumps(content)}
    found = typst.query(
        str(article.SOURCE), "<drawing>", field="value", root=str(workbook.ROOT), sys_inputs=inputs
    )
    drawn = json.loads(found)
    assert len(drawn) >= 5
    assert not [each["name"] for each in drawn if each["smallest"] < 7 - 1e-6]
