"""The report: one page with everything that the paper prints beside ours, and the way to each proof."""

import json
import math
from pathlib import Path

import pandas as pd

from replication import published, workbook
from replication.report import cells as cells_of
from replication.report import errata, findings, regions, tables, web
from replication.report import facts as facts_of
from replication.report.cells import Cell, Judgement
from replication.report.figures import Picture, pictures
from replication.workbook import files, judging, provenance

EQUATION_10 = (("A3", "A³"), ("A2", "A²"), ("A1", "A"), ("A0", ""))


def cell_name(cell: Cell) -> str:
    """Call a cell by its place: "Table 2, row 3, sd"."""
    row = f"row {cell.row}" if cell.row.isdigit() else cell.row
    column = "" if cell.column == "value" else f", {cell.column.replace('_', ' ')}"
    return f"{cell.element}, {row}{column}"


def ours(cell: Cell, judgement: Judgement) -> str:
    """Write our number like the printed one; where that is a share, of what."""
    number = cells_of.like_printed(judgement.ours, cell.printed)
    return f"{number} of {cell.share_of}" if number and cell.share_of else number


def difference(judgement: Judgement) -> str:
    """Write what our number is off the printed one; nothing where there is no number."""
    return "" if math.isnan(judgement.difference) else f"{judgement.difference:+.3g}"


def corrected_cells() -> dict[str, str]:
    """The erratum that corrects a cell, by the cell's id."""
    named = published.errata()["cells"].items()
    return {part.partition("=")[0]: str(key) for key, cells in named for part in cells.split()}


def claim_rows(results: Path) -> list[dict]:
    """The claims with check and rule, decision, measured number and proof."""
    decided = judging.decided_claims(results).set_index("id")
    rows = published.claims().join(decided).fillna("").reset_index().to_dict("records")
    return [
        row
        | {"verdict": row["verdict"] or "not decided"}
        | {"check": f"{row['check']} Rule: {row['rule']} {row['criterion']:g}."}
        for row in rows
    ]


def _sensitivity(results: Path) -> tuple[list[dict], list[str]]:
    """The matrix of `sensitivity.csv`: a row a constant, how many cells of each group notice it."""
    file = results / "sensitivity.csv"
    if not file.exists():
        return [], []
    table = pd.read_csv(file, keep_default_na=False)
    kinds = ["Table", "Equation", "Figure", "Text", "claims", "tests"]
    columns = sorted(dict.fromkeys(name for name in table["group"] if name), key=lambda name: _order(name, kinds))
    rows = []
    for (constant, value, changed), part in table.groupby(["constant", "value", "changed"], sort=False):
        noticed = part[part["group"] != ""]
        counts = noticed["group"].value_counts()
        examples = list(noticed.drop_duplicates("group")["id"])
        counted = {name: int(counts.get(name, 0)) for name in columns}
        rows.append({"constant": constant, "value": value, "changed": changed, "counts": counted})
        rows[-1]["examples"] = ", ".join(examples) or "nothing"
    return rows, columns


def _order(group: str, kinds: list[str]) -> tuple[int, str]:
    kind = group.split()[0].rstrip(",")
    return (kinds.index(kind) if kind in kinds else len(kinds), group)


def _versions(made_from: dict[str, dict]) -> dict[str, str]:
    """Versions of Python and of the packages that the results were made with, by name."""
    found: dict[str, set[str]] = {}
    for record in made_from.values():
        for name, version in ({"Python": record["python"]} | record["packages"]).items():
            found.setdefault(name, set()).add(version)
    return {name: " and ".join(sorted(versions)) for name, versions in sorted(found.items())}


def _paper_figures(drawn: list[Picture]) -> list[dict]:
    """The paper's figures that have a counterpart: what the paper shows, what can be compared, and ours."""
    mapped = published.paper_map().set_index("element")
    about = published.paper_figures()
    return [
        {
            "element": element,
            "what": mapped.loc[element, "what"],
            "shows": about.loc[element, "shows"],
            "compare": about.loc[element, "compare"],
            "pictures": [picture for picture in drawn if picture.element == element],
        }
        for element in about.index
    ]


def page(results: Path, notebooks: Path, verdicts: pd.DataFrame, quick: bool = False) -> str:
    """Render the report."""
    all_cells = cells_of.cells(verdicts)
    drawn = pictures(results, results.parent / "figures")
    found = findings.findings(facts_of.facts(results, verdicts))
    sensitivity, columns = _sensitivity(results)
    mapped = published.paper_map()
    made_from = json.loads((results / "provenance.json").read_text(encoding="utf-8"))
    return web.ENVIRONMENT.get_template("report.html.j2").render(
        quick=quick,
        root="../../.." if quick else "..",
        signs=cells_of.SIGNS,
        sources=cells_of.SOURCES,
        source_names=cells_of.SOURCES,
        number=cells_of.number,
        ours=ours,
        cell_name=cell_name,
        difference=difference,
        region=regions.region,
        region_picture=regions.picture,
        corrected=corrected_cells(),
        findings=[each for each in found if each.kind == "finding"],
        open=[each for each in found if each.kind == "open"],
        counts=cells_of.counts(all_cells),
        meanings=cells_of.MEANINGS,
        evidence=cells_of.EVIDENCE,
        layouts=[(layout, tables.rows(layout, all_cells)) for layout in tables.LAYOUTS],
        groups=tables.groups,
        column_summary=tables.column_summary,
        cells=cells_of.by_id(all_cells),
        footnotes={cell.id: position for position, cell in enumerate(all_cells, start=1)},
        by_element={name: tables.others(all_cells, name) for name in ("Equation 10", "Text")},
        equation10=EQUATION_10,
        element_pictures={
            element: [picture for picture in drawn if picture.element == element]
            for element in ("Table 1", "Table 2", "Table 3", "Table 4", "Equation 10")
        },
        notes=mapped.set_index("element")["note"].to_dict(),
        figures=_paper_figures(drawn),
        not_computed=mapped[mapped["notebooks"] == ""].to_dict("records"),
        beyond=[picture for picture in drawn if not picture.element],
        claims=claim_rows(results),
        errata=published.errata().reset_index().to_dict("records"),
        errata_counted=errata.counted(),
        verdicts=verdicts.to_dict("records"),
        filters={
            "verdict": list(dict.fromkeys(verdicts["verdict"])),
            "element": list(dict.fromkeys(cell.element for cell in all_cells)),
            "source": sorted(set(verdicts["source"])),
        },
        sensitivity=sensitivity,
        sensitivity_columns=columns,
        unnoticed=sum(not any(row["counts"].values()) for row in sensitivity),
        map=mapped.to_dict("records"),
        notebooks=[(file.stem, web.title(file)) for file in sorted(notebooks.glob("[0-9]*.ipynb"))],
        versions=_versions(made_from),
        stale=provenance.stale(results),
    )


def write_page(results: Path) -> Path:
    """Write `report.html` beside the results, and the notebooks' pages that it links to."""
    from replication.report import pages  # nbconvert takes two seconds to load, which no other command should wait for

    quick = results == workbook.QUICK / "results"
    notebooks = results.parent / "notebooks"
    web.notebook_cells.cache_clear()
    verdicts = judging.verdicts(results)
    pages.write_pages(results, notebooks, verdicts)
    path = results / "report.html"
    files.write_text(path, page(results, notebooks, verdicts, quick))
    return path
