"""The commands that show results: check, show, report, diff, readme, article."""

import argparse
import sys
from pathlib import Path

from replication import workbook
from replication.report import errata, flips, page, readme, terminal
from replication.workbook import judging, provenance


def add_commands(subparsers: "argparse._SubParsersAction") -> None:
    """Add the commands to the program's."""
    check = subparsers.add_parser(
        "check", help="print the tables with their verdicts; exit 1 if a cell differs unexpectedly"
    )
    check.add_argument("--quick", action="store_true", help="of the quick run")
    check.add_argument("--strict", action="store_true", help="exit 1 if any cell differs, expected or not")
    check.set_defaults(command=_check)

    show = subparsers.add_parser("show", help="a cell, an element or a claim: printed, ours, verdict and why")
    show.add_argument("name", help="such as table2.row03.sd, 'Table 2', local_minima or E3")
    show.add_argument("--rerun", action="store_true", help="make just that again, and show it beside")
    show.set_defaults(command=_show)

    report = subparsers.add_parser("report", help="results/report.html, the notebooks' pages and errata.md")
    report.add_argument("--quick", action="store_true", help="of the quick run")
    report.set_defaults(command=_report)

    diff = subparsers.add_parser("diff", help="cells and claims whose verdict is not that of the last commit's results")
    made = diff.add_mutually_exclusive_group()
    made.add_argument("--quick", action="store_const", dest="made", const="quick", help="of the quick run")
    made.add_argument("--lab", action="store_const", dest="made", const="lab", help="of notebooks run by hand")
    diff.set_defaults(command=_diff)

    subparsers.add_parser("article", help="results/article.pdf from article/article.typ and the results").set_defaults(
        command=_article
    )
    subparsers.add_parser("readme", help="write the results' numbers into README.md").set_defaults(command=_readme)


def results_folder(quick: bool) -> Path:
    """Folder of the results, or of the quick run's."""
    return (workbook.QUICK if quick else workbook.ROOT) / "results"


def _check(options: argparse.Namespace) -> int:
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


def _show(options: argparse.Namespace) -> int:
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


def _report(options: argparse.Namespace) -> int:
    results = results_folder(options.quick)
    errata.write_sheet(results)
    print(page.write_page(results))
    return 0


def _diff(options: argparse.Namespace) -> int:
    results = workbook.ROOT / "results"
    if options.made:
        results = results / options.made / "results"
    try:
        table = flips.flips(results, flips.committed("verdicts.csv"), flips.committed("claims.csv"))
    except flips.NoCommit as error:
        print(error, file=sys.stderr)
        return 1
    print(table.to_string(index=False) if len(table) else "no verdict flipped")
    return 0


def _article(_: argparse.Namespace) -> int:
    from replication.report import article

    try:
        print(article.write_article(workbook.ROOT / "results"))
    except (article.NotTypeset, ImportError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def _readme(_: argparse.Namespace) -> int:
    readme.update_readme(workbook.ROOT / "README.md", workbook.ROOT / "results")
    return 0
