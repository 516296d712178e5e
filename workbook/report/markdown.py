"""What is written as Markdown: the errata as one page for the journal, and the README's block of verdicts."""

from pathlib import Path

from replication import files, published
from workbook import judging
from workbook.report import TEMPLATES
from workbook.report.facts import collect_facts

KINDS = {"paper": "in the paper", "public repository": "in the public repository"}
BEGIN, END = "<!-- status: begin -->\n", "\n<!-- status: end -->"


def count_errata() -> str:
    """Say how many errata there are of each kind."""
    counts = published.errata()["kind"].value_counts(sort=False)
    return ", ".join(f"{number} {KINDS.get(str(kind), kind)}" for kind, number in counts.items())


def render_errata() -> str:
    """Write the errata sheet."""
    errata = published.errata().astype(str).replace(r"\|", r"\\|", regex=True).reset_index()
    rows = errata.to_dict("records")
    return TEMPLATES.get_template("errata.md.j2").render(counted=count_errata(), errata=rows)


def render_status(results: Path) -> str:
    """Write the README's status: printed numbers by element and verdict, and all by tolerance alone."""
    verdicts = judging.verdicts(results)
    counts = judging.verdict_counts(verdicts)
    counts.loc["all"] = counts.sum()
    former = judging.deciding(verdicts)["by_tolerance"].value_counts()
    counts.loc["all, by tolerance alone"] = former.reindex(counts.columns, fill_value=0)
    table, facts = counts.astype(int), collect_facts(results, verdicts)
    return TEMPLATES.get_template("status.md.j2").render(table=table, facts=facts)


def update_readme(readme: Path, results: Path) -> None:
    """Replace the README's status with what the results say; `ValueError` if its marks are missing."""
    text = readme.read_text(encoding="utf-8")
    if BEGIN not in text or END not in text:
        raise ValueError(f"{readme.name}: the marks {BEGIN.strip()} and {END.strip()} are missing")
    before, after = text.partition(BEGIN)[0], text.partition(END)[2]
    files.write_text(readme, f"{before}{BEGIN}{render_status(results)}{END}{after}")
