"""The verdict at a notebook's end: this run's numbers beside the printed and the committed ones."""

import pandas as pd

from replication.records import records_are_simulated
from workbook.checkout import RESULTS
from workbook.outcomes import OUTPUT_FOLDER, Cells, Claims, Sentence, cell_rows


def judge(cells: Cells | None = None, claims: Claims | None = None) -> pd.DataFrame:
    """Compare our numbers and decisions, as `workbook.export` takes them, with the printed ones.

    Returns
    -------
    DataFrame
        A row a number or claim: id; the printed number; ours, of realisations their median; the
        interval that a printed number must lie in to agree; the committed number, which is ours
        where this run makes what is committed; and the verdict.
    """
    from workbook import judging  # with the search, which not every notebook computes with

    rows = judging.judge_rows(pd.DataFrame(cell_rows(cells or {})).assign(notebook=""))
    decided = [
        {"id": claim, "ours": measured, "verdict": judging.CLAIM_VERDICTS[holds]}
        for claim, (holds, measured) in (claims or {}).items()
    ]
    table = pd.DataFrame(
        {
            "id": rows["id"],
            "printed": rows["printed"],
            "ours": rows["reproduced"],
            "low": rows["low"],
            "high": rows["high"],
            "verdict": rows["agreement"],
        }
    )
    table = pd.concat([table.astype(object), pd.DataFrame(decided, dtype=object)])
    table.insert(5, "committed", table["ours"])
    if records_are_simulated() or not OUTPUT_FOLDER:
        table["committed"] = table["id"].map(_committed())
    return table.fillna("").set_index("id").map(_five_digits)


def _five_digits(value: object) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _committed() -> pd.Series:
    """Committed numbers and measurements, by the id of a printed number or a claim."""
    numbers = pd.read_csv(RESULTS / "verdicts.csv", index_col="id")["reproduced"]
    claims = pd.read_csv(RESULTS / "claims.csv", index_col="id")["measured"]
    return pd.concat([numbers.astype(object), claims])


def verdict(text: str, cells: Cells | None = None, claims: Claims | None = None) -> None:
    """Show how this run's numbers compare, as `judge` does, and a sentence on them.

    Parameters
    ----------
    text : str
        A sentence in Markdown, made of this run's numbers alone.
    cells, claims : mappings
        As `workbook.export` takes them.
    """
    from IPython.display import display

    if cells or claims:
        display(judge(cells, claims))
    display(Sentence(text))
