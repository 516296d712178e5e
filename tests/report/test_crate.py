"""The RO-Crate of the results: what archives read of what was made from what."""

import ast
import json
import re

import pytest
from places import RESULTS
from rocrate.rocrate import ROCrate

import workbook
from replication.authors import AUTHORS_URL, authors_registry
from replication.files import write_json
from workbook.checkout import notebook_files
from workbook.report.crate import describe_results
from workbook.report.figures import load_pictures

NAME = "ro-crate-metadata.json"


@pytest.fixture(scope="module")
def crate(tmp_path_factory):
    """The crate of the committed results, described anew and read again by ro-crate-py."""
    folder = tmp_path_factory.mktemp("crate")
    write_json(folder / NAME, describe_results(RESULTS))
    return ROCrate(folder)


def runs(crate):
    return {run["name"].rpartition("/")[2].removesuffix(".py"): run for run in crate.get_by_type("CreateAction")}


def exported(source, keyword):
    """Names that the call `workbook.export` of a notebook gives in one of its mappings."""
    tree = ast.parse(source.read_text(encoding="utf-8"))
    calls = [
        node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("export")
    ]
    mappings = [each.value for call in calls for each in call.keywords if each.arg == keyword]
    return {key.value for mapping in mappings for key in mapping.keys}


def test_the_committed_crate_is_what_the_results_give_and_small():
    written = json.dumps(describe_results(RESULTS), indent=1) + "\n"
    assert written == json.dumps(describe_results(RESULTS), indent=1) + "\n"
    assert len(written) < 300_000
    assert (RESULTS / NAME).read_text(encoding="utf-8") == written, "run: make report"


def test_every_entity_has_a_type_and_every_reference_an_entity():
    described = describe_results(RESULTS)
    graph = {entity["@id"]: entity for entity in described["@graph"]}
    assert len(graph) == len(described["@graph"])
    assert all(entity["@type"] for entity in graph.values())
    values = [value for entity in graph.values() for value in entity.values()]
    referred = [each["@id"] for value in values for each in (value if isinstance(value, list) else [value])
                if isinstance(each, dict)]  # fmt: skip
    assert set(referred) - set(graph) == {"https://w3id.org/ro/crate/1.1"}
    assert not [name for name in graph if re.search(r"\s", name)]


def test_every_file_that_it_names_is_there(crate):
    inside = [entity.id for entity in crate.get_by_type("File") if not entity.id.startswith("https://")]
    assert len(inside) > 100
    beside = [entity.id.removeprefix("#") for entity in crate.contextual_entities if "/" in entity.id.partition("#")[2]]
    assert len(beside) > 50
    assert [name for name in inside if not (RESULTS / name).is_file()] == []
    assert [name for name in beside if not (workbook.ROOT / name).is_file()] == []
    assert {"verdicts.csv", "report.html", "article.pdf", "pages/08_noise_table2.html"} <= set(inside)


def test_every_run_says_what_it_read_and_what_it_made(crate):
    made_from = json.loads((RESULTS / "provenance.json").read_text(encoding="utf-8"))
    assert set(runs(crate)) == set(made_from)
    for name, run in runs(crate).items():
        source = notebook_files("py")[name]
        assert run["instrument"].id == f"#{source.relative_to(workbook.ROOT).as_posix()}"
        results = [entity.id for entity in run["result"]]
        assert len(results) == len(set(results))
        assert {each for each in results if each.endswith(".csv")} == {f"{t}.csv" for t in exported(source, "tables")}
        drawn = {f"#figures/{picture.name}.svg" for picture in load_pictures(RESULTS) if picture.notebook == name}
        assert {each for each in results if each.startswith("#figures/")} == drawn
        packages = {entity["name"]: entity["version"] for entity in run["instrument"]["softwareRequirements"]}
        assert packages == {"Python": made_from[name]["python"]} | made_from[name]["packages"]


def test_the_authors_files_are_named_by_their_address_and_digest(crate):
    files = [entity for entity in crate.get_by_type("File") if entity.id.startswith(AUTHORS_URL)]
    assert len(files) > 10
    assert all(entity["sha256"] == authors_registry()[entity["name"]] for entity in files)
    assert {entity["license"]["name"] for entity in files} == {"EUPL-1.2"}


def test_nothing_of_it_is_from_the_clock(crate):
    assert crate.root_dataset["datePublished"] in (workbook.ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert "Time" not in "".join(json.dumps(entity.properties()) for entity in crate.get_by_type("CreateAction"))
