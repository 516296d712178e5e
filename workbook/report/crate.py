"""The RO-Crate of the results: what was made from what, for archives and code checkers."""

import json
import re
from mimetypes import guess_type
from pathlib import Path
from typing import Any
from urllib.parse import quote

import yaml

from replication.files import ROOT
from replication.records import AUTHORS_URL
from workbook.outcomes import load_outcomes
from workbook.report import TEMPLATES
from workbook.report.cells import notebook_source

# The term sha256 is newer than RO-Crate 1.1.
CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "http://schema.org/sha256"}]
# What git ignores, and the crate itself.
NOT_ARCHIVED = re.compile(r"(lab|offline|quick)/|(run|ro-crate-metadata)\.json|(.*/)?\.")
EUPL = {"@id": "https://spdx.org/licenses/EUPL-1.2"}


def describe_results(results: Path) -> dict[str, Any]:
    """Describe a results folder as an RO-Crate 1.1: its files, and what each run read and made.

    A crate's files lie in its folder or on the web. Notebooks, figures and data of the project lie
    beside the results, and the project has no public address: they are contextual entities, named
    "#" and their path in the project.
    """
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    checked = yaml.safe_load((ROOT / "codecheck.yml").read_text("utf-8"))
    comments = {entry["file"]: entry["comment"] for entry in checked["manifest"]}
    given = json.loads(TEMPLATES.get_template("crate.json.j2").render(cited=cited))
    graph: dict[str, dict[str, Any]] = {entity["@id"]: entity for entity in given}

    def add(identifier: str, kind: str, name: str, **about: object) -> dict[str, str]:
        """Add an entity, if it is not there yet; return how others refer to it."""
        graph.setdefault(identifier, {"@id": identifier, "@type": kind, "name": name, **about})
        return {"@id": identifier}

    for file in sorted(path.relative_to(results).as_posix() for path in results.rglob("*.*")):
        if not NOT_ARCHIVED.match(file):
            name = comments.get(f"results/{file}", file)
            add(file, "File", name, encodingFormat=guess_type(file)[0])
    whole = graph["./"]
    for notebook, outcome in load_outcomes(results).items():
        made_from, source = outcome["made_from"], notebook_source(notebook)
        read = [
            add(AUTHORS_URL + quote(name), "File", name, sha256=digest, license=EUPL)
            for name, digest in made_from["inputs"].items()
        ]
        for name, digest in made_from["sources"].items():
            inside = name.removeprefix("results/")
            if inside in graph:
                read.append({"@id": inside})
            elif not name.endswith(
                ".py"
            ):  # those of the modules, which are many, are in provenance.json
                read.append(add(f"#{name}", "CreativeWork", name, sha256=digest))
        versions = {"Python": made_from["python"]} | made_from["packages"]
        software = [
            add(f"#{name}-{version}", "SoftwareApplication", name, version=version)
            for name, version in versions.items()
        ]
        about = {"sha256": made_from["sources"][source], "softwareRequirements": software}
        program = add(f"#{source}", "SoftwareSourceCode", source, **about)
        made = [{"@id": file} for file in (*outcome["files"], f"outcomes/{notebook}.json")]
        made += [
            add(f"#figures/{name}.svg", "ImageObject", name, caption=figure["caption"])
            for name, figure in outcome["figures"].items()
        ]
        about = {"agent": whole["author"], "instrument": program, "object": read, "result": made}
        add(f"#run-{notebook}", "CreateAction", f"Run of {source}", **about)
    for key, kind in (("hasPart", "File"), ("mentions", "CreateAction")):
        whole[key] = [{"@id": name} for name, entity in graph.items() if entity["@type"] == kind]
    return {"@context": CONTEXT, "@graph": list(graph.values())}
