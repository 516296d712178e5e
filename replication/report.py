"""Results to pages: the report, and the README's status block."""

import html
from pathlib import Path

import pandas as pd

from replication import published, workbook

BEGIN, END = "<!-- status: begin -->", "<!-- status: end -->"

PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>A virtual sensor for backlash: the replication</title>
<style>
body {{ font-family: sans-serif; max-width: 75em; margin: auto; padding: 1em; }}
.wide {{ overflow-x: auto; }}
table {{ border-collapse: collapse; font-size: 0.85em; }}
th, td {{ border-bottom: 1px solid #ccc; padding: 0.2em 0.6em; text-align: left; vertical-align: top; }}
svg {{ max-width: 100%; height: auto; }}
</style>
<h1>A virtual sensor for backlash in robotic manipulators: the replication</h1>
<h2>Verdicts</h2>
<div class="wide">{counts}</div>
<p>{stand_in}</p>
<h2>Printed and reproduced</h2>
<div class="wide">{cells}</div>
<h2>Claims in the text</h2>
<div class="wide">{claims}</div>
<h2>Errata</h2>
<div class="wide">{errata}</div>
<h2>Figures</h2>
{figures}
</html>
"""

STAND_IN = (
    "Tables 3 and 4 come from logs that were never published: whatever is computed for them is a stand-in, "
    "and never counts as reproduced."
)


def _number(value: float) -> str:
    return "" if pd.isna(value) else f"{value:.5g}"


def _table(frame: pd.DataFrame) -> str:
    """Render a frame as an HTML table, its text escaped and its notebooks linked."""
    escaped = frame.map(lambda cell: html.escape(cell) if isinstance(cell, str) else cell)
    if "notebook" in frame:
        link = '<a href="../notebooks/{0}.ipynb">{0}</a>'.format
        escaped["notebook"] = [link(html.escape(name)) if isinstance(name, str) else "" for name in frame["notebook"]]
    return escaped.to_html(index=False, na_rep="", float_format=_number, escape=False)


def write_page(results: Path) -> Path:
    """Write `report.html` beside the results: one self-contained page.

    Parameters
    ----------
    results : Path
        Folder of the results; the figures are in the folder `figures` beside it.

    Returns
    -------
    Path
    """
    table = workbook.verdicts(results)
    claims = pd.read_csv(results / "claims.csv")
    figures = sorted((results.parent / "figures").glob("*.svg"))
    drawn = [f"<h3>{file.stem}</h3>\n{_inline_svg(file)}" for file in figures]
    page = PAGE.format(
        counts=_table(workbook.verdict_counts(table).reset_index().rename_axis(columns=None)),
        stand_in=STAND_IN,
        cells=_table(table),
        claims=_table(claims),
        errata=_table(published.errata().drop(columns="cells").reset_index()),
        figures="\n".join(drawn),
    )
    path = results / "report.html"
    workbook.write_text(path, page)
    return path


def _inline_svg(file: Path) -> str:
    """Read an SVG file's element, its ids made unique by the file's name, so that figures do not share markers."""
    text = file.read_text(encoding="utf-8")
    text = text[text.index("<svg") :]
    prefix = file.stem + "-"
    return (
        text.replace('id="', f'id="{prefix}').replace('href="#', f'href="#{prefix}').replace("url(#", f"url(#{prefix}")
    )


def status(results: Path) -> str:
    """Make the README's status block: verdicts by element and source, and Table 2's best basin."""
    counts = workbook.verdict_counts(workbook.verdicts(results)).reset_index()
    lines = ["| " + " | ".join(counts.columns) + " |", "|" + "---|" * len(counts.columns)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in counts.itertuples(index=False)]
    total = counts.drop(columns=["element", "source"]).sum()
    summary = ", ".join(f"{number} {verdict}" for verdict, number in total.items())
    return f"{summary} (cells by source):\n\n" + "\n".join(lines)


def update_readme(readme: Path, results: Path) -> None:
    """Replace the README's status block with what the results say.

    Raises
    ------
    ValueError
        The README lacks the marks of the block.
    """
    text = readme.read_text(encoding="utf-8")
    if BEGIN not in text or END not in text:
        raise ValueError(f"{readme.name}: the marks {BEGIN} and {END} are missing")
    head, rest = text.split(BEGIN, 1)
    tail = rest.split(END, 1)[1]
    workbook.write_text(readme, f"{head}{BEGIN}\n{status(results)}\n{END}{tail}")
