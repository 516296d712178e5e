"""What is written as Markdown: the errata, the supplement's list, the README's verdicts."""

from pathlib import Path

from replication import files
from workbook import judging
from workbook.outcomes import load_outcomes
from workbook.report import TEMPLATES
from workbook.report.cells import notebook_source
from workbook.report.facts import collect_facts, count_numbers, fill_in_findings, list_errata

BEGIN, END = "<!-- status: begin -->\n", "\n<!-- status: end -->"


def render_errata(facts: dict[str, str]) -> str:
    """Write the errata sheet."""
    escaped = {r"\|": r"\\|", r"<(?=[A-Za-z/!?])": "&lt;"}
    rows = list_errata(facts).replace(escaped, regex=True).to_dict("records")
    return TEMPLATES.get_template("errata.md.j2").render(facts=facts, errata=rows)


def render_supplement(results: Path) -> str:
    """Write the list of the tables that no text and no page needs."""
    outcomes = load_outcomes(results)
    listed = {notebook_source(name): outcome["supplement"] for name, outcome in outcomes.items()}
    return TEMPLATES.get_template("supplement.md.j2").render(listed=listed)


def render_status(results: Path) -> str:
    """Write the README's status: the answers, and the printed numbers by element and by source."""
    verdicts = judging.verdicts(results)
    facts = collect_facts(results, verdicts)
    by_element, by_source = count_numbers(verdicts)
    return TEMPLATES.get_template("status.md.j2").render(
        facts=facts, findings=fill_in_findings(facts), by_element=by_element, by_source=by_source
    )


def update_readme(readme: Path, results: Path) -> None:
    """Replace the README's status by what the results say; `ValueError` without its marks."""
    text = readme.read_text(encoding="utf-8")
    if BEGIN not in text or END not in text:
        raise ValueError(f"{readme.name}: the marks {BEGIN.strip()} and {END.strip()} are missing")
    before, after = text.partition(BEGIN)[0], text.partition(END)[2]
    files.write_text(readme, f"{before}{BEGIN}{render_status(results)}{END}{after}")
