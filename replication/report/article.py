"""The replication article: typeset from a text whose every number comes from the results."""

import json
from pathlib import Path

import pandas as pd

from replication import files, published
from replication.report.cells import MEANINGS, SIGNS, judged_cells, judged_claims
from replication.report.facts import collect_facts, fill_in_findings
from replication.report.figures import load_pictures
from replication.workbook import judging

SOURCE = files.ROOT / "article" / "article.typ"


class NotTypeset(RuntimeError):
    """The article's text asks for something that the results do not have, or typst is not installed."""

    exit_status = 1


def collect_content(results: Path) -> dict:
    """Collect what the article's text takes from the results."""
    verdicts = judging.verdicts(results)
    facts = collect_facts(results, verdicts)
    table2 = _table2(results, verdicts)
    signs = {row[name] for row in table2 for name in ("mean_sign", "sd_sign")}
    legend = [f"{SIGNS[name]} {name}" for name in MEANINGS if SIGNS[name] in signs]
    claims = [row | {"sign": SIGNS[row["verdict"]]} for row in judged_claims(results)]
    return {
        "facts": facts,
        "table2": table2,
        "legend": ", ".join(legend),
        "claims": [{name: row[name] for name in ("claim", "sign", "verdict", "measured")} for row in claims],
        "errata": published.errata()[["kind", "location", "as_printed", "corrected"]].reset_index().to_dict("records"),
        "open": [each["text"] for each in fill_in_findings(facts) if each["kind"] == "open"],
        "captions": {picture.name: picture.caption for picture in load_pictures(results)},
    }


def _table2(results: Path, verdicts: pd.DataFrame) -> list[dict[str, str]]:
    """Table 2's ten rows on the authors' records: printed, ours over the realisations, and the verdicts' signs."""
    cells = judged_cells(verdicts)
    table = pd.read_csv(results / "table2.csv").query("source == 'authors' and row <= 10")
    rows = []
    for row, part in table.groupby("row"):
        theoretical, mean, sd = (cells[f"table2.row{row:02d}.{name}"] for name in ("theoretical", "mean", "sd"))
        rows.append(
            {
                "row": str(row),
                "theoretical": theoretical.printed,
                "printed_mean": mean.printed,
                "mean_sign": SIGNS[mean.deciding.verdict],
                "mean": _from_to(part["mean_A_rps"], 3),
                "region": _from_to(pd.Series([mean.deciding.low, mean.deciding.high]), 3),
                "best": _from_to(part["best_A_rps"], 3),
                "printed_sd": sd.printed,
                "sd_sign": SIGNS[sd.deciding.verdict],
                "sd": _from_to(part["sd_A_rps"], 4),
                "share": f"{part['best_basin_runs'].sum()} of {part['runs'].sum()}",
            }
        )
    return rows


def _from_to(values: pd.Series, digits: int) -> str:
    return f"{values.min():.{digits}f}–{values.max():.{digits}f}"


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
