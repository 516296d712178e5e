"""The replication article: typeset from a text whose every number comes from the results."""

import json
from pathlib import Path

import pandas as pd

from replication import files, published
from workbook import judging
from workbook.report.cells import MEANINGS, SIGNS, judged_cells, judged_claims
from workbook.report.facts import collect_facts, fill_in_findings
from workbook.report.figures import load_pictures

SOURCE = files.ROOT / "article" / "article.typ"


class NotTypeset(RuntimeError):
    """The article's text asks for what the results do not have, or typst is not installed."""

    exit_status = 1


def collect_content(results: Path) -> dict:
    """Collect what the article's text takes from the results and does not read itself."""
    verdicts = judging.verdicts(results)
    facts = collect_facts(results, verdicts)
    claims = pd.DataFrame(judged_claims(results))
    claims["sign"] = claims["verdict"].map(SIGNS)
    errata = ["kind", "location", "as_printed", "corrected", "evidence"]
    return {
        "facts": facts,
        "tables": collect_tables(verdicts),
        "signs": {name: SIGNS[name] for name in MEANINGS},
        "claims": claims[["claim", "sign", "verdict", "measured", "decided_in"]].to_dict("records"),
        "errata": published.errata()[errata].reset_index().to_dict("records"),
        "open": [each["text"] for each in fill_in_findings(facts) if each["kind"] == "open"],
        "captions": {picture.name: picture.caption for picture in load_pictures(results)},
    }


def collect_tables(verdicts: pd.DataFrame) -> dict[str, list[dict]]:
    """The rows of each table: by column, the printed number, ours and the sign of its verdict."""
    tables: dict[str, dict[str, dict]] = {}
    for cell in judged_cells(verdicts).values():
        judged = cell.deciding
        beside = {
            "printed": cell.printed,
            "ours": cell.ours(judged),
            "sign": SIGNS[judged.verdict],
            "unit": cell.unit,
        }
        row = tables.setdefault(cell.element, {}).setdefault(cell.row, {"row": cell.row})
        row[cell.column] = beside
    return {element: list(rows.values()) for element, rows in tables.items()}


def typeset(results: Path) -> bytes:
    """Typeset the article as a PDF, the same for the same results."""
    try:
        import typst  # only the article needs it
    except ImportError as error:
        raise NotTypeset(f"{error}: the article needs the extra `article`") from error
    inputs = {"data": json.dumps(collect_content(results))}
    try:
        # Fonts that only this machine has would make other bytes elsewhere.
        return typst.compile(
            str(SOURCE), root=str(files.ROOT), sys_inputs=inputs, ignore_system_fonts=True
        )
    except typst.TypstError as error:
        raise NotTypeset(f"article/article.typ: {error}") from error
