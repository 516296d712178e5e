"""The report: a page that answers, and the pages with every number, claim, erratum and element of the paper."""

import ast
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd
from markupsafe import Markup

from replication import files, published
from workbook import checkout, judging
from workbook.due import stale
from workbook.outcomes import load_outcomes
from workbook.report import TEMPLATES, markdown, pages
from workbook.report.cells import judged_cells, judged_claims
from workbook.report.datasheet import datasheet_rows, read_rows
from workbook.report.facts import (
    collect_facts,
    count_numbers,
    fill_in_findings,
    list_errata,
    list_rules,
)
from workbook.report.figures import load_pictures

# Files of the report and what the line above each page calls them.
PLACES = [
    ("report.html", "Report"),
    ("pages/numbers.html", "All numbers"),
    ("pages/claims.html", "Claims"),
    ("pages/errata.html", "Errata"),
    ("pages/datasheet.html", "Sensor's datasheet"),
    ("pages/map.html", "Paper map"),
    ("pages/00_the_sensor.html", "Notebooks"),
    ("pages/history.html", "History"),
    ("article.pdf", "Article"),
]


def report_content(results: Path, verdicts: pd.DataFrame) -> dict[str, Any]:
    """What the report's templates show."""
    facts = collect_facts(results, verdicts)
    cells = judged_cells(verdicts)
    by_element, by_source = count_numbers(verdicts)
    return {
        "facts": facts,
        "cells": cells,
        "findings": fill_in_findings(facts),
        "by_element": by_element,
        "by_source": by_source,
        "filters": {
            "agreement": judging.AGREEMENTS,
            "source": list(by_source.index),
            "element": list(dict.fromkeys(cell.element for cell in cells.values())),
        },
        "pictures": load_pictures(results),
        "map": published.table("map").set_index("element").to_dict("index"),
        "figures": published.table("paper_figures").reset_index().to_dict("records"),
        "claims": judged_claims(results),
        "errata": list_errata(facts).to_dict("records"),
        "history": list_rules(facts),
        "rounds": read_rows(results, "datasheet_rounds"),
        "datasheet": datasheet_rows(results),
        "versions": _versions(results),
        "stale": stale(results),
        "code_line": code_line,
    }


def render_report(results: Path, verdicts: pd.DataFrame, apart: str = "") -> dict[str, str]:
    """Render the report's pages by their file below the results."""
    content = report_content(results, verdicts)
    above = "../../.." if apart else ".."
    rendered = {}
    for file, _ in PLACES:
        name = file.removeprefix("pages/")
        if f"{name}.j2" in TEMPLATES.list_templates():
            up = "../" if file.startswith("pages/") else ""
            rendered[file] = TEMPLATES.get_template(f"{name}.j2").render(
                content, places=PLACES, here=file, up=up, root=up + above, apart=apart
            )
    return rendered


@cache
def code_line(name: str) -> str:
    """Address of a function, or of a test "file::name", with the line at which it begins."""
    file, _, function = name.partition("::")
    if not function:
        module, _, function = name.rpartition(".")
        folder = "" if module.startswith("studies.") else "replication/"
        file = f"{folder}{module.replace('.', '/')}.py"
    tree = ast.parse((files.ROOT / file).read_text(encoding="utf-8"))
    defined = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef))
    return next(f"{file}#L{node.lineno}" for node in defined if node.name == function)


@cache
def static(name: str) -> Markup:
    """A style sheet or script as it is."""
    return Markup((Path(__file__).parent / "templates" / name).read_text(encoding="utf-8"))


TEMPLATES.globals["static"] = static


def _versions(results: Path) -> dict[str, str]:
    """Versions of Python and of the packages that the results were made with, by name."""
    found: dict[str, set[str]] = {}
    for outcome in load_outcomes(results).values():
        made_from = outcome["made_from"]
        for name, version in ({"Python": made_from["python"]} | made_from["packages"]).items():
            found.setdefault(name, set()).add(version)
    return {name: " and ".join(sorted(versions)) for name, versions in sorted(found.items())}


def write_report(results: Path) -> Path:
    """Write the tables of verdicts, `report.html`, its pages, `errata.md` and the supplement's list."""
    verdicts = judging.collect(results)
    apart = checkout.APART.get(results.parent, "")
    rendered = render_report(results, verdicts, apart) | pages.render_pages(results, verdicts)
    for file, text in rendered.items():
        files.write_text(results / file, text)
    for path in (results / "pages").glob("*.html"):
        if f"pages/{path.name}" not in rendered:
            path.unlink()
    facts = collect_facts(results, verdicts)
    files.write_text(results / "errata.md", markdown.render_errata(facts))
    files.write_text(results / "supplement" / "README.md", markdown.render_supplement(results))
    return results / "report.html"
