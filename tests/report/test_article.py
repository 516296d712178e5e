"""The replication article: it is typeset from the results, and no place in it is empty."""

import pytest

from workbook.checkout import RESULTS
from workbook.report import article

typst = pytest.importorskip("typst", reason="typst is not installed (extra `article`)")


def test_the_committed_article_is_what_the_results_give():
    assert (RESULTS / "article.pdf").read_bytes() == article.typeset(RESULTS), "run: make article"


@pytest.mark.slow
@pytest.mark.parametrize("changed", [{"best_worst_high": ""}, {"printed": None}])
def test_a_number_that_is_empty_or_not_there_stops_the_typesetting(changed, monkeypatch):
    (name,) = changed
    content = article.collect_content(RESULTS)
    facts = {key: value for key, value in (content["facts"] | changed).items() if value is not None}
    monkeypatch.setattr(article, "collect_content", lambda _: content | {"facts": facts})
    with pytest.raises(article.NotTypeset, match=name):
        article.typeset(RESULTS)


def test_a_final_article_names_every_blank_that_is_open(tmp_path, monkeypatch):
    file = tmp_path / "citation"
    file.write_text('name: "OPEN: a name"  # and "OPEN: a place"', "utf-8")
    monkeypatch.setattr(article, "WITH_BLANKS", (file,))
    with pytest.raises(article.NotTypeset, match=r"citation: a name; .*citation: a place$"):
        article.typeset(RESULTS, final=True)
