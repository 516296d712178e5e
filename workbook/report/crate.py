"""The RO-Crate of the results: what was made from what, for archives and code checkers."""

import json
import re
from pathlib import Path
from urllib.parse import quote

import yaml
from rocrate.model.contextentity import ContextEntity
from rocrate.rocrate import ROCrate

from replication.authors import AUTHORS_URL
from replication.files import ROOT
from workbook.report import TEMPLATES
from workbook.report.cells import notebook_source
from workbook.report.figures import load_pictures

FORMATS = {"json": "application/json", "md": "text/markdown", "pdf": "application/pdf"}  # of others: text/ and ending
NOT_ARCHIVED = re.compile(r"(lab|quick)/|(run|ro-crate-metadata)\.json|(.*/)?\.")  # what git ignores; the crate itself


def describe_results(results: Path) -> dict:
    """Describe a results folder as an RO-Crate 1.1: its files, and what each notebook's run read and made.

    A crate's files lie in its folder or on the web. Notebooks, figures and data of the project lie beside the results,
    and the project has no public address: they are contextual entities, named "#" and their path in the project.
    """
    cited, checked = (yaml.safe_load((ROOT / name).read_text("utf-8")) for name in ("CITATION.cff", "codecheck.yml"))
    comments = {entry["file"].removeprefix("results/"): entry["comment"] for entry in checked["manifest"]}
    crate = ROCrate(version="1.1")
    crate.metadata.extra_terms["sha256"] = "http://schema.org/sha256"  # newer than the terms of RO-Crate 1.1
    for entity in json.loads(TEMPLATES.get_template("crate.json.j2").render(cited=cited)):
        crate.add_or_update_jsonld(entity)

    def add(kind: str, identifier: str, name: str, **properties: object) -> ContextEntity:
        return crate.add(ContextEntity(crate, identifier, {"@type": kind, "name": name, **properties}))

    for file in sorted(path.relative_to(results).as_posix() for path in results.rglob("*.*")):
        if not NOT_ARCHIVED.match(file):
            ending = file.rpartition(".")[2]
            about = {"name": comments.get(file, file), "encodingFormat": FORMATS.get(ending, f"text/{ending}")}
            crate.add_file(dest_path=file, properties=about)
    pictures = load_pictures(results)
    for notebook, made_from in json.loads((results / "provenance.json").read_text("utf-8")).items():
        read = []
        for name, digest in made_from["inputs"].items():
            about = {"name": name, "sha256": digest, "license": crate.get("https://spdx.org/licenses/EUPL-1.2")}
            read.append(crate.add_file(AUTHORS_URL + quote(name), properties=about))
        for name, digest in made_from["sources"].items():
            if not name.endswith(".py"):  # the digests of the modules, which are many, are in provenance.json
                inside = crate.get(name.removeprefix("results/"))
                read.append(inside or add("CreativeWork", f"#{name}", name, sha256=digest))
        source, versions = notebook_source(notebook), {"Python": made_from["python"], **made_from["packages"]}
        software = [add("SoftwareApplication", f"#{name}-{v}", name, version=v) for name, v in versions.items()]
        about = {"sha256": made_from["sources"][source], "softwareRequirements": software}
        program = add("SoftwareSourceCode", f"#{source}", source, **about)
        closing = (ROOT / source).read_text("utf-8").partition("workbook.export(")[2]
        tables = [f"{name}.csv" for name in dict.fromkeys(re.findall(r'"(\w+)":', closing))]
        made = [*filter(None, map(crate.get, tables)), crate.get(f"outcomes/{notebook}.json")]
        for picture in (picture for picture in pictures if picture.notebook == notebook):
            made.append(add("ImageObject", f"#figures/{picture.name}.svg", picture.name, caption=picture.caption))
        about = {"agent": crate.root_dataset["author"], "instrument": program, "object": read, "result": made}
        crate.root_dataset.append_to("mentions", add("CreateAction", f"#run-{notebook}", f"Run of {source}", **about))
    return crate.metadata.generate()
