"""The errata as one page that could be sent to the journal."""

from pathlib import Path

from replication import published
from replication.workbook import files

HEAD = """# Errata for "A virtual sensor for backlash in robotic manipulators"

E. Giovannitti, S. Nabavi, G. Squillero, A. Tonda, Journal of Intelligent Manufacturing, doi:10.1007/s10845-022-01934-z.
Found while replicating the paper; each is proved by a test of the replication, named in the last column. Two
entries, on the public read-me and on public data, concern the published data set and not the paper.

| | where | as printed | correct | what follows | proof |
|---|---|---|---|---|---|
"""


def sheet() -> str:
    """Write the errata sheet, in Markdown."""
    rows = []
    for key, row in published.errata().iterrows():
        file, _, test = row["evidence"].partition("::")
        proof = f"[{test.removeprefix('test_').replace('_', ' ')}](../{file})"
        cells = [key, row["location"], row["as_printed"], row["corrected"], row["effect"], proof]
        rows.append("| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |")
    return HEAD + "\n".join(rows) + "\n"


def write_sheet(results: Path) -> Path:
    """Write `errata.md` into the results' folder."""
    path = results / "errata.md"
    files.write_text(path, sheet())
    return path
