"""The RO-Crate of the results: what archives read of what was made from what."""

import json
import re

import pytest

import workbook
from replication.authors import AUTHORS_URL, authors_registry
from replication.files import write_json
from workbook.checkout import RESULTS, notebook_files
from workbook.outcomes import load_outcomes
from workbook.report.crate import describe_results

NAME = "ro-crate-metadata.json"
OUTCOMES = load_outcomes(RESULTS)


@pytest.fixture(scope="module")
def described():
    return describe_results(RESULTS)


@pytest.fixture(scope="module")
def crate(described, tmp_path_factory):
    """The crate of the committed results, described anew and read by ro-crate-py."""
    rocrate = pytest.importorskip(
        "rocrate.rocrate", reason="rocrate is not installed (extra `dev`)"
    )
    folder = tmp_path_factory.mktemp("crate")
    write_json(folder / NAME, described)
    return rocrate.ROCrate(folder)


def test_the_committed_crate_is_what_the_results_give_and_small(described):
    written = json.dumps(described, indent=1) + "\n"
    assert len(written) < 300_000
    assert (RESULTS / NAME).read_text("utf-8") == written, "run: make report"


def test_every_entity_has_a_type_and_every_reference_an_entity(described):
    graph = {entity["@id"]: entity for entity in described["@graph"]}
    assert len(graph) == len(described["@graph"])
    assert all(entity["@type"] for entity in graph.values())
    referred = set(re.findall(r'\{"@id": "([^"]+)"\}', json.dumps(described)))
    assert referred - set(graph) == {"https://w3id.org/ro/crate/1.1"}
    assert not [name for name in graph if re.search(r"\s", name)]


def test_every_file_that_it_names_is_there(crate):
    inside = [
        entity.id for entity in crate.get_by_type("File") if not entity.id.startswith("https://")
    ]
    made = {
        file.relative_to(RESULTS).as_posix()
        for pattern in ("*.csv", "*.md", "outcomes/*.json", "pages/*", "supplement/*")
        for file in RESULTS.glob(pattern)
    }
    assert len(made) > 80
    assert made <= set(inside)
    beside = [
        entity.id.removeprefix("#")
        for entity in crate.contextual_entities
        if "/" in entity.id.partition("#")[2]
    ]
    assert len(beside) > 50
    assert [name for name in inside if not (RESULTS / name).is_file()] == []
    assert [name for name in beside if not (workbook.ROOT / name).is_file()] == []
    assert {"verdicts.csv", "report.html", "article.pdf", "pages/08_noise_table2.html"} <= set(
        inside
    )


def test_every_run_says_what_it_read_and_what_it_made(crate):
    runs = {run.id.removeprefix("#run-"): run for run in crate.get_by_type("CreateAction")}
    assert set(runs) == set(OUTCOMES)
    assert crate.root_dataset["mentions"] == list(runs.values())
    for name, run in runs.items():
        outcome, source = (
            OUTCOMES[name],
            notebook_files("py")[name].relative_to(workbook.ROOT).as_posix(),
        )
        assert run["instrument"].id == f"#{source}"
        made = {*outcome["files"], f"outcomes/{name}.json"}
        made |= {f"#figures/{figure}.svg" for figure in outcome["figures"]}
        results = [entity.id for entity in run["result"]]
        assert sorted(results) == sorted(made)
        packages = {
            entity["name"]: entity["version"]
            for entity in run["instrument"]["softwareRequirements"]
        }
        assert (
            packages
            == {"Python": outcome["made_from"]["python"]} | outcome["made_from"]["packages"]
        )


def test_the_authors_files_are_named_by_their_address_and_digest(crate):
    files = [entity for entity in crate.get_by_type("File") if entity.id.startswith(AUTHORS_URL)]
    assert len(files) > 10
    assert all(entity["sha256"] == authors_registry()[entity["name"]] for entity in files)
    assert {entity["license"]["name"] for entity in files} == {"EUPL-1.2"}


def test_nothing_of_it_is_from_the_clock(described):
    (whole,) = (entity for entity in described["@graph"] if entity["@id"] == "./")
    assert whole["datePublished"] in (workbook.ROOT / "CITATION.cff").read_text("utf-8")
    assert "Time" not in json.dumps(
        [e for e in described["@graph"] if e["@type"] == "CreateAction"]
    )
