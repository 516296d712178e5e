"""The replication article: typeset from a text whose every number comes from the results."""

import json
from pathlib import Path

import pandas as pd

from replication import files, published
from workbook import judging
from workbook.report.cells import MEANINGS, SIGNS, Cell, judged_cells, judged_claims
from workbook.report.facts import collect_facts, fill_in_findings
from workbook.report.figures import load_pictures

SOURCE = files.ROOT / "article" / "article.typ"


class NotTypeset(RuntimeError):
    """The article's text asks for something that the results do not have, or typst is not installed."""

    exit_status = 1


def collect_content(results: Path) -> dict:
    """Collect what the article's text takes from the results."""
    verdicts = judging.verdicts(results)
    facts, cells = collect_facts(results, verdicts), judged_cells(verdicts)
    tables = {name: _beside(cells, name) for name in ("Table 1", "Table 2", "Table 3", "Table 4")}
    ranges = _table2_ranges(results, cells)
    tables["Table 2"] = [row | ranges[row["row"]] for row in tables["Table 2"]]
    claims = pd.DataFrame(judged_claims(results)).assign(sign=lambda table: table["verdict"].map(SIGNS))
    errata = ["kind", "location", "as_printed", "corrected", "evidence"]
    return {
        "facts": facts,
        "tables": tables,
        "signs": {name: SIGNS[name] for name in MEANINGS},
        "claims": claims[["claim", "sign", "verdict", "measured", "decided_in"]].to_dict("records"),
        "errata": published.errata()[errata].reset_index().to_dict("records"),
        "open": [each["text"] for each in fill_in_findings(facts) if each["kind"] == "open"],
        "captions": {picture.name: picture.caption for picture in load_pictures(results)},
    }


def _beside(cells: dict[str, Cell], element: str) -> list[dict]:
    """The rows of a table of the paper: by column, the printed number, ours and the sign of its verdict."""
    rows: dict[str, dict] = {}
    for cell in cells.values():
        if cell.element == element:
            beside = {"printed": cell.printed, "ours": cell.ours(cell.deciding), "sign": SIGNS[cell.deciding.verdict]}
            rows.setdefault(cell.row, {"row": cell.row})[cell.column] = beside | {"unit": cell.unit}
    return list(rows.values())


def _table2_ranges(results: Path, cells: dict[str, Cell]) -> dict[str, dict[str, str]]:
    """Lowest to highest of our realisations for each row of Table 2, and the region of its mean."""
    ranges = {}
    for row, part in pd.read_csv(results / "table2.csv").query("source == 'authors' or row == 11").groupby("row"):
        mean = cells[f"table2.row{row:02d}.mean"].deciding
        ranges[str(row)] = {
            "means": _from_to(part["mean_A_rps"], 3),
            "region": _from_to(pd.Series([mean.low, mean.high]), 3),
            "best": _from_to(part["best_A_rps"], 3),
            "sds": _from_to(part["sd_A_rps"], 4),
            "share": f"{part['best_basin_runs'].sum()} of {part['runs'].sum()}",
        }
    return ranges


def _from_to(values: pd.Series, digits: int) -> str:
    return f"{values.min():.{digits}f} to {values.max():.{digits}f}".replace("-", "−")


def typeset(results: Path) -> bytes:
    """Typeset the article as a PDF, the same for the same results."""
    try:
        import typst  # only the article needs it
    except ImportError as error:
        raise NotTypeset(f"{error}: the article needs the extra `article`") from error
    inputs = {"data": json.dumps(collect_content(results))}
    try:
        # Fonts that only this machine has would make other bytes elsewhere.
        return typst.compile(str(SOURCE), root=str(files.ROOT), sys_inputs=inputs, ignore_system_fonts=True)
    except typst.TypstError as error:
        raise NotTypeset(f"article/article.typ: {error}") from error
