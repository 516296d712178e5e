"""The README's block of verdicts, made from the results."""

from pathlib import Path

import pandas as pd

from replication.report import facts
from replication.workbook import files, judging

MULTIPLICITY = (
    "{regions} regions of {level} % judge Table 2's means and SDs: by chance alone, {regions_missed_by_chance} is\n"
    "expected to miss. With 30 other seeds {seeds_flipped} of these verdicts are different ones."
)


def status(results: Path) -> str:
    """Make the README's status block: printed numbers by element and verdict, and all by the former tolerances."""
    verdicts = judging.verdicts(results)
    counts = judging.verdict_counts(verdicts)
    counts.loc["all"] = counts.sum()
    former = judging.deciding(verdicts)["by_tolerance"].value_counts()
    counts.loc["all, by the tolerances before"] = former.reindex(counts.columns, fill_value=0)
    table = _markdown(counts.astype(int).rename_axis("printed numbers").reset_index())
    return f"{table}\n\n{MULTIPLICITY.format_map(facts.facts(results, verdicts))}"


def _markdown(table: pd.DataFrame) -> str:
    """Write a Markdown table; zeros are left blank."""
    rows = [table.columns, ["-"] * len(table.columns), *table.itertuples(index=False)]
    return "\n".join("|" + "".join(f" {cell} |" if cell else " |" for cell in row) for row in rows)


def block(text: str, name: str) -> str:
    """Find a block of the README between its marks.

    Raises
    ------
    ValueError
        The marks are missing.
    """
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    if begin not in text or end not in text:
        raise ValueError(f"the marks {begin} and {end} are missing")
    return text.split(begin, 1)[1].split(end, 1)[0]


def update_readme(readme: Path, results: Path) -> None:
    """Replace the README's block with what the results say.

    Raises
    ------
    ValueError
        The README lacks the marks of the block.
    """
    text = readme.read_text(encoding="utf-8")
    marks = f"<!-- status: begin -->{block(text, 'status')}", f"<!-- status: begin -->\n{status(results)}\n"
    files.write_text(readme, text.replace(*marks))
