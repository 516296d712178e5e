"""The commands that show results: check, show, report, diff, readme, article."""

import argparse
from pathlib import Path

from replication.files import ROOT, write_bytes
from workbook import judging, provenance
from workbook.checkout import QUICK
from workbook.report import diff, markdown, terminal

RESULTS = ROOT / "results"


def results_folder(quick: bool) -> Path:
    """Folder of the results, or of the quick run's."""
    return QUICK / "results" if quick else RESULTS


def run_check(options: argparse.Namespace) -> int:
    """Print the tables with their verdicts."""
    results = results_folder(options.quick)
    verdicts = judging.verdicts(results)
    print(terminal.verdict_tables(verdicts, terminal.has_colour()))
    new, gone = terminal.find_surprises(verdicts)
    expected = "All cells that differ are known differences (replication/data/differences.csv)."
    print("\n".join(["", *new, *gone] if new or gone else [expected]))
    for notebook, changed in provenance.stale(results).items():
        print(f"stale: {notebook}: sources changed since its results: {', '.join(changed)}")
    return int((verdicts["verdict"] == "differs").any() if options.strict else bool(new))


def run_show(options: argparse.Namespace) -> int:
    """Print a cell, an element or a claim."""
    said = terminal.show(options.name, RESULTS, judging.verdicts(RESULTS), terminal.has_colour())
    if options.rerun:
        from workbook.running import rerun

        table = rerun(options.name, RESULTS)
        said += f"\n\nComputed again; the stored results are unchanged.\n{table.to_string(index=False)}"
    print(said)
    return 0


def run_report(options: argparse.Namespace) -> int:
    """Write the report, the notebooks' pages and the errata."""
    from workbook.report import page

    print(page.write_report(results_folder(options.quick)))
    return 0


def run_diff(options: argparse.Namespace) -> int:
    """Print what flipped since the last commit's results."""
    results = RESULTS / options.made / "results" if options.made else RESULTS
    table = diff.list_changes(results, diff.committed_table("verdicts.csv"), diff.committed_table("claims.csv"))
    print("\n".join(map(diff.describe_change, table.to_dict("records"))) or "nothing changed")
    return 0


def run_article(_: argparse.Namespace) -> int:
    """Typeset the article."""
    from workbook.report import article

    path = RESULTS / "article.pdf"
    write_bytes(path, article.typeset(RESULTS))
    print(path)
    return 0


def run_readme(_: argparse.Namespace) -> int:
    """Write the results' numbers into the README."""
    markdown.update_readme(ROOT / "README.md", RESULTS)
    return 0
