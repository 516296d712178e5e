"""The report: one page with everything that the paper prints beside ours, and the way to each proof."""

import json
from pathlib import Path

import pandas as pd

from replication import files, published
from workbook import checkout, judging, provenance
from workbook.report import TEMPLATES, answers, markdown, pages
from workbook.report.cells import judged_cells, judged_claims
from workbook.report.crate import describe_results
from workbook.report.facts import collect_facts, fill, fill_in_findings
from workbook.report.figures import load_pictures
from workbook.report.tables import LAYOUTS

SENSITIVITY_GROUPS = ("Table", "Equation", "Figure", "Text", "claims", "tests")


def render_report(results: Path, notebooks: Path, verdicts: pd.DataFrame, quick: bool = False) -> str:
    """Render the report."""
    cells = judged_cells(verdicts)
    paper_map, errata = published.paper_map(), published.errata().reset_index()
    sensitivity, sensitivity_columns = _sensitivity(results)
    facts = collect_facts(results, verdicts)
    return TEMPLATES.get_template("report.html.j2").render(
        quick=quick,
        root="../../.." if quick else "..",
        findings=fill_in_findings(facts),
        counts=judging.verdict_counts(verdicts).sum().astype(int).to_dict(),
        layouts=LAYOUTS,
        cells=cells,
        footnotes={cell: position for position, cell in enumerate(cells, start=1)},
        pictures=load_pictures(results),
        notes=paper_map.set_index("element")["note"].to_dict(),
        figures=published.paper_figures().reset_index().to_dict("records"),
        map=paper_map.to_dict("records"),
        claims=judged_claims(results),
        errata=[row | {"computed": fill(row["computed"], facts)} for row in errata.to_dict("records")],
        trail=[row | {"counts": fill(row["counts"], facts)} for row in published.trail().to_dict("records")],
        table2_rows=answers.table2_dumbbells(results, cells),
        runs=answers.runs_of_cells(results),
        functions=paper_map.set_index("element")["functions"].to_dict() | {"Text": ""},
        code_line=answers.code_line,
        disagreement=answers.disagreement,
        other_seeds=answers.verdicts_by_other_seeds(results),
        facts=facts,
        times=answers.run_times(results),
        has_explorer=(results / "start_log.csv").exists(),
        has_replay=(results / "replay_frames.csv").exists(),
        errata_counted=markdown.count_errata(),
        filters={
            "verdict": list(verdicts["verdict"].unique()),
            "element": list(dict.fromkeys(cell.element for cell in cells.values())),
            "source": sorted(verdicts["source"].unique()),
        },
        datasheet=pd.read_csv(sheet).to_dict("records") if (sheet := results / "datasheet.csv").exists() else [],
        refusals=_refusals(results),
        sensitivity=sensitivity,
        sensitivity_columns=sensitivity_columns,
        notebooks={name: pages.headings(found)[0] for name, found in pages.executed_cells(notebooks).items()},
        versions=_versions(results),
        stale=provenance.stale(results),
    )


def _sensitivity(results: Path) -> tuple[list[dict], list[str]]:
    """The rows of `sensitivity.csv`, a constant each with how many cells of each group notice it; and the groups."""
    if not (file := results / "sensitivity.csv").exists():
        return [], []
    table, keys = pd.read_csv(file, keep_default_na=False), ["constant", "value", "changed"]
    rows = []
    for constant, part in table.groupby(keys, sort=False):
        noticed = part[part["group"] != ""]
        examples = ", ".join(noticed.drop_duplicates("group")["id"]) or "nothing"
        counts = noticed["group"].value_counts().to_dict()
        rows.append(dict(zip(keys, constant, strict=True)) | {"counts": counts, "examples": examples})
    groups = set(table["group"]) - {""}
    return rows, sorted(groups, key=lambda group: (SENSITIVITY_GROUPS.index(group.split()[0]), group))


def _refusals(results: Path) -> list[dict]:
    """Why the self-calibrating sensor refused logs, and how many, the commonest reason first."""
    if not (file := results / "self_refused.csv").exists():
        return []
    counts = pd.read_csv(file).groupby("reason", as_index=False)["logs"].sum()
    return counts.sort_values("logs", ascending=False, kind="stable").to_dict("records")


def _versions(results: Path) -> dict[str, str]:
    """Versions of Python and of the packages that the results were made with, by name."""
    made_from = json.loads((results / "provenance.json").read_text(encoding="utf-8"))
    found: dict[str, set[str]] = {}
    for record in made_from.values():
        for name, version in ({"Python": record["python"]} | record["packages"]).items():
            found.setdefault(name, set()).add(version)
    return {name: " and ".join(sorted(versions)) for name, versions in sorted(found.items())}


def write_report(results: Path) -> Path:
    """Write `report.html`, the notebooks' pages that it links to and `errata.md` into a results folder."""
    quick = results == checkout.QUICK / "results"
    notebooks, verdicts = results.parent / "notebooks", judging.verdicts(results)
    rendered = pages.render_pages(results, notebooks, verdicts)
    for name, text in rendered.items():
        files.write_text(results / "pages" / f"{name}.html", text)
    for file in (results / "pages").glob("*.html"):
        if file.stem not in rendered:
            file.unlink()
    files.write_text(results / "errata.md", markdown.render_errata())
    files.write_text(results / "report.html", render_report(results, notebooks, verdicts, quick))
    files.write_json(results / "ro-crate-metadata.json", describe_results(results))
    return results / "report.html"
