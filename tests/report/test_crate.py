"""The RO-Crate of the results: what archives read of what was made from what."""

import json

import pytest

from workbook.checkout import RESULTS
from workbook.report.crate import describe_results

NAME = "ro-crate-metadata.json"


def test_the_committed_crate_is_what_the_results_give_and_every_file_in_it_is_there():
    described = describe_results(RESULTS)
    written = json.dumps(described, indent=1) + "\n"
    assert (RESULTS / NAME).read_text("utf-8") == written, "run: make report"
    rocrate = pytest.importorskip("rocrate.rocrate", reason="rocrate is not installed")
    files = {entity.id for entity in rocrate.ROCrate(RESULTS).get_by_type("File")}
    inside = {name for name in files if not name.startswith("https://")}
    assert {"verdicts.csv", "report.html", "article.pdf"} <= inside
    assert [name for name in inside if not (RESULTS / name).is_file()] == []
