"""The commands that show results: check, show, report, diff, readme, article."""

import argparse
import sys
from pathlib import Path

from replication import workbook
from replication.report import errata, flips, page, readme, terminal
from replication.workbook import judging, provenance


def results_folder(quick: bool) -> Path:
    """Folder of the results, or of the quick run's."""
    return (workbook.QUICK if quick else workbook.ROOT) / "results"


def run_check(options: argparse.Namespace) -> int:
    """Print the tables with their verdicts."""
    table = judging.verdicts(results_folder(options.quick))
    print(terminal.verdict_tables(table, terminal.colourful()))
    surprises = terminal.unexpected(table)
    if surprises:
        print("\n".join(["", *surprises]))
    else:
        print("Every cell that differs is a known difference (replication/data/differences.csv).")
    for notebook, changed in provenance.stale(results_folder(options.quick)).items():
        print(f"stale: {notebook}: changed since: {', '.join(changed)}")
    any_differs = (table["verdict"] == "differs").any()
    return int(any_differs if options.strict else any("differs, and" in line for line in surprises))


def run_show(options: argparse.Namespace) -> int:
    """Print a cell, an element or a claim."""
    results = workbook.ROOT / "results"
    table = judging.verdicts(results)
    try:
        print(terminal.show(options.name, results, table, terminal.colourful()))
        if options.rerun:
            return _rerun(options.name, results)
    except terminal.Unknown as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _rerun(name: str, results: Path) -> int:
    from replication.workbook import rerun  # the kernel's client takes a second and a half to load

    try:
        table = rerun.rerun(name, results)
    except rerun.NotMade as error:
        print(error, file=sys.stderr)
        return 2
    print(f"\nExecuted again, apart from the results, which stay as they are.\n{table.to_string(index=False)}")
    return 0


def run_report(options: argparse.Namespace) -> int:
    """Write the report, the notebooks' pages and the errata."""
    results = results_folder(options.quick)
    errata.write_sheet(results)
    print(page.write_page(results))
    return 0


def run_diff(options: argparse.Namespace) -> int:
    """Print what flipped since the last commit's results."""
    results = workbook.ROOT / "results"
    if options.made:
        results = results / options.made / "results"
    try:
        table = flips.changes(results, flips.committed("verdicts.csv"), flips.committed("claims.csv"))
    except flips.NotComparable as error:
        print(error, file=sys.stderr)
        return 1
    print("\n".join(map(flips.describe, table.to_dict("records"))) or "nothing moved")
    return 0


def run_article(_: argparse.Namespace) -> int:
    """Typeset the article."""
    from replication.report import article

    try:
        print(article.write_article(workbook.ROOT / "results"))
    except (article.NotTypeset, ImportError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def run_readme(_: argparse.Namespace) -> int:
    """Write the results' numbers into the README."""
    readme.update_readme(workbook.ROOT / "README.md", workbook.ROOT / "results")
    return 0
