"""The replication article: typeset from a text whose every number comes from the results."""

import json
from pathlib import Path

import pandas as pd

from replication import published, workbook
from replication.report import cells as cells_of
from replication.report import facts, figures, findings, page
from replication.workbook import files, judging

ERRATUM = ("id", "kind", "location", "as_printed", "corrected")
SOURCE = workbook.ROOT / "article" / "article.typ"


class NotTypeset(RuntimeError):
    """The article's text asks for something that the results do not have."""


def content(results: Path) -> dict:
    """Collect what the article's text takes from the results.

    Parameters
    ----------
    results : Path
        Folder of the results.

    Returns
    -------
    dict
        `facts`, `table2`, `claims`, `errata`, `open`, `captions` and the `legend` of the verdicts' signs.
    """
    verdicts = judging.verdicts(results)
    all_facts = facts.facts(results, verdicts)
    drawn = figures.pictures(results, results.parent / "figures")
    rows = _table2(results, verdicts)
    signs = {sign for row in rows for sign in (row["mean_sign"], row["sd_sign"])}
    return {
        "facts": all_facts,
        "table2": rows,
        "errata": published.errata().reset_index()[list(ERRATUM)].to_dict("records"),
        "open": [each.text for each in findings.findings(all_facts) if each.kind == "open"],
        "captions": {picture.name: picture.caption for picture in drawn},
        "legend": ", ".join(
            f"{cells_of.SIGNS[name]} {name}" for name in cells_of.MEANINGS if cells_of.SIGNS[name] in signs
        ),
        "claims": [
            {name: row[name] for name in ("claim", "verdict", "measured")} | {"sign": cells_of.SIGNS[row["verdict"]]}
            for row in page.claim_rows(results)
        ],
    }


def _table2(results: Path, verdicts: pd.DataFrame) -> list[dict[str, str]]:
    """Table 2's ten rows on the authors' records: printed, ours over the realisations, and the verdicts' signs."""
    by_id = cells_of.by_id(cells_of.cells(verdicts))
    table = pd.read_csv(results / "table2.csv")
    of_authors = table[(table["source"] == "authors") & (table["theoretical_A_rps"] > 0)]
    rows = []
    for row, part in of_authors.groupby("row"):
        head = f"table2.row{row:02d}"
        mean, sd = by_id[f"{head}.mean"], by_id[f"{head}.sd"]
        rows.append(
            {
                "row": str(row),
                "theoretical": by_id[f"{head}.theoretical"].printed,
                "printed_mean": mean.printed,
                "mean_sign": cells_of.SIGNS[mean.deciding.verdict],
                "mean": _from_to(part["mean_A_rps"], 3),
                "region": _from_to(pd.Series([mean.deciding.low, mean.deciding.high]), 3),
                "best": _from_to(part["best_A_rps"], 3),
                "printed_sd": sd.printed,
                "sd_sign": cells_of.SIGNS[sd.deciding.verdict],
                "sd": _from_to(part["sd_A_rps"], 4),
                "share": f"{part['best_basin_runs'].sum()} of {part['runs'].sum()}",
            }
        )
    return rows


def _from_to(values: pd.Series, digits: int) -> str:
    return f"{values.min():.{digits}f}–{values.max():.{digits}f}"


def typeset(results: Path) -> bytes:
    """Typeset the article.

    Parameters
    ----------
    results : Path
        Folder of the results; the figures are in the folder `figures` beside it.

    Returns
    -------
    bytes
        The PDF, the same for the same results.

    Raises
    ------
    NotTypeset
        The text names a number or a figure that the results do not have.
    """
    import typst  # only the article needs it

    inputs = {"data": json.dumps(content(results))}
    try:
        # Fonts that only this machine has would make other bytes elsewhere.
        return typst.compile(str(SOURCE), root=str(workbook.ROOT), sys_inputs=inputs, ignore_system_fonts=True)
    except typst.TypstError as error:
        raise NotTypeset(f"article/article.typ: {error}") from error


def write_article(results: Path) -> Path:
    """Write `article.pdf` into the results' folder."""
    path = results / "article.pdf"
    files.write_bytes(path, typeset(results))
    return path
