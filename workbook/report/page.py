"""The report: one page with everything that the paper prints beside ours, and the way to each proof."""

import ast
from functools import cache
from pathlib import Path

import pandas as pd

from replication import files, published
from workbook import checkout, judging
from workbook.due import stale
from workbook.outcomes import load_outcomes
from workbook.report import TEMPLATES, markdown, pages
from workbook.report.cells import judged_cells, judged_claims
from workbook.report.crate import describe_results
from workbook.report.facts import collect_facts, fill, fill_in_findings
from workbook.report.figures import load_pictures, share
from workbook.report.tables import LAYOUTS


def render_report(results: Path, notebooks: Path, verdicts: pd.DataFrame, apart: str = "") -> str:
    """Render the report."""
    cells, facts = judged_cells(verdicts), collect_facts(results, verdicts)
    executed = pages.executed_cells(notebooks)
    errata = published.table("errata").reset_index()
    errata["computed"] = [fill(text, facts) for text in errata["computed"]]
    page = TEMPLATES.get_template("report.html.j2").render(
        apart=apart,
        root="../../.." if apart else "..",
        facts=facts,
        findings=fill_in_findings(facts),
        counts=judging.count_by(verdicts, "element").sum().to_dict(),
        by_source=judging.count_by(verdicts, "source"),
        layouts=LAYOUTS,
        cells=cells,
        footnotes={cell: number for number, cell in enumerate(cells, start=1)},
        drawn={"runs": {}, "by_protocol": {}} | pages.load_drawn(results, "report"),
        sensor=pages.load_drawn(results, "sensor"),
        pictures=load_pictures(results),
        map=published.table("map").set_index("element").to_dict("index"),
        code_line=code_line,
        figures=published.table("paper_figures").reset_index().to_dict("records"),
        claims=judged_claims(results),
        errata=errata.to_dict("records"),
        times={row["notebook"]: row for row in _rows(results, "notebook_times")},
        explorers=pages.explorers(results),
        datasheet=_rows(results, "datasheet"),
        titles={name: pages.headings(found)[0] for name, found in executed.items()},
        versions=_versions(results),
        stale=stale(results),
    )
    return share(page)


def render_history(results: Path, verdicts: pd.DataFrame) -> str:
    """Render the page that tells in which order rules and results came."""
    facts, trail = collect_facts(results, verdicts), published.table("trail")
    trail["counts"] = [fill(text, facts) for text in trail["counts"]]
    return TEMPLATES.get_template("history.html.j2").render(
        facts=facts,
        trail=trail.to_dict("records"),
        claims=judged_claims(results),
        rounds=_rows(results, "datasheet_rounds"),
    )


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


def _rows(results: Path, table: str) -> list[dict]:
    """The rows of a table of the results; none if it is not there."""
    file = results / f"{table}.csv"
    return pd.read_csv(file).to_dict("records") if file.exists() else []


def _versions(results: Path) -> dict[str, str]:
    """Versions of Python and of the packages that the results were made with, by name."""
    found: dict[str, set[str]] = {}
    for outcome in load_outcomes(results).values():
        made_from = outcome["made_from"]
        for name, version in ({"Python": made_from["python"]} | made_from["packages"]).items():
            found.setdefault(name, set()).add(version)
    return {name: " and ".join(sorted(versions)) for name, versions in sorted(found.items())}


def write_report(results: Path) -> Path:
    """Write `report.html`, the pages that it links to, `errata.md` and the supplement's list."""
    apart = checkout.APART.get(results.parent, "")
    notebooks, verdicts = results.parent / "notebooks", judging.verdicts(results)
    rendered = pages.render_pages(results, notebooks, verdicts)
    rendered["history"] = render_history(results, verdicts)
    for name, text in rendered.items():
        files.write_text(results / "pages" / f"{name}.html", text)
    for file in (results / "pages").glob("*.html"):
        if file.stem not in rendered:
            file.unlink()
    facts = collect_facts(results, verdicts)
    files.write_text(results / "errata.md", markdown.render_errata(facts))
    files.write_text(results / "supplement" / "README.md", markdown.render_supplement(results))
    files.write_text(results / "report.html", render_report(results, notebooks, verdicts, apart))
    files.write_json(results / "ro-crate-metadata.json", describe_results(results))
    return results / "report.html"
