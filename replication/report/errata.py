"""The errata as one page that could be sent to the journal."""

from pathlib import Path

from replication import published
from replication.workbook import files

HEAD = """# Errata for "A virtual sensor for backlash in robotic manipulators"

E. Giovannitti, S. Nabavi, G. Squillero, A. Tonda, Journal of Intelligent Manufacturing, doi:10.1007/s10845-022-01934-z.
Found while replicating the paper; each is proved by a test of the replication, named in the last column.
KINDS. The paper's own numbers and sentences prove the first kind; the second contradicts the public records and need
not be a misprint; the third is no error of the paper.

| | kind | where | as printed | correct | what follows | proof |
|---|---|---|---|---|---|---|
"""


def counts() -> dict[str, int]:
    """Count the errata by kind: "paper", "against the public data", "public repository"."""
    return published.errata()["kind"].value_counts(sort=False).to_dict()


def counted() -> str:
    """Say how many errata there are of each kind."""
    return ", ".join(f"{number} of the kind \"{kind}\"" for kind, number in counts().items())


def sheet() -> str:
    """Write the errata sheet, in Markdown."""
    rows = []
    for key, row in published.errata().iterrows():
        file, _, test = row["evidence"].partition("::")
        proof = f"[{test.removeprefix('test_').replace('_', ' ')}](../{file})"
        cells = [key, row["kind"], row["location"], row["as_printed"], row["corrected"], row["effect"], proof]
        rows.append("| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |")
    return HEAD.replace("KINDS", counted()) + "\n".join(rows) + "\n"


def write_sheet(results: Path) -> Path:
    """Write `errata.md` into the results' folder."""
    path = results / "errata.md"
    files.write_text(path, sheet())
    return path
