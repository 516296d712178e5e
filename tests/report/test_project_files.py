"""What hosts and librarians read: the citation file, the article's metadata, the workflow."""

import re
from datetime import date

import yaml

import workbook

ROOT = workbook.ROOT


def text_of(name):
    return (ROOT / name).read_text("utf-8")


def read(name):
    return yaml.safe_load(text_of(name))


def test_the_citation_file_has_what_its_format_demands_and_cites_the_paper():
    citation = read("CITATION.cff")
    assert {"cff-version", "title", "message", "authors"} <= set(citation)
    assert citation["cff-version"] == "1.2.0"
    assert citation["abstract"]
    assert isinstance(citation["date-released"], date)
    assert citation["license"] in text_of("pyproject.toml")
    assert f'version = "{citation["version"]}"' in text_of("pyproject.toml")
    (paper,) = citation["references"]
    assert paper["title"] == "A virtual sensor for backlash in robotic manipulators"
    assert [author["family-names"] for author in paper["authors"]] == [
        "Giovannitti",
        "Nabavi",
        "Squillero",
        "Tonda",
    ]
    assert re.fullmatch(r"10\.\d+/\S+", paper["doi"])


def test_the_articles_metadata_cite_the_same_paper():
    metadata = read("article/metadata.yaml")
    fields = {name: value for entry in metadata["replication"] for name, value in entry.items()}
    assert fields["doi"] == read("CITATION.cff")["references"][0]["doi"]
    assert metadata["title"].startswith("[Re] ")


def test_the_workflow_runs_what_make_offers_and_keeps_what_is_there():
    workflow = read(".github/workflows/test.yml")
    targets = re.findall(r"^([a-z-]+):.*##", text_of("Makefile"), re.MULTILINE)
    for job in ("test", "weekly"):
        run = [step["run"].split() for step in workflow["jobs"][job]["steps"] if "run" in step]
        assert {tuple(words[:2]) for words in run} <= {("make", target) for target in targets}
    steps = workflow["jobs"]["test"]["steps"]
    kept = next(step["with"]["path"] for step in steps if "upload-artifact" in step.get("uses", ""))
    assert all((ROOT / path).exists() for path in kept.split())


def test_a_codechecker_finds_every_output_that_is_listed():
    listed = [entry["file"] for entry in read("codecheck.yml")["manifest"]]
    assert len(listed) > 10
    assert text_of("codecheck.yml").startswith("%YAML 1.1\n---\n")  # its specification asks
    assert [name for name in listed if not (ROOT / name).exists()] == []


def test_the_pages_workflow_may_publish():
    workflow = read(".github/workflows/pages.yml")
    assert workflow["permissions"]["pages"] == "write"
    assert any(
        "deploy-pages" in step.get("uses", "") for step in workflow["jobs"]["publish"]["steps"]
    )
