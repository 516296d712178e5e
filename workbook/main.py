"""The workbook's command line; it does the same as the Makefile."""

import os
from pathlib import Path

from workbook.parser import OneLineParser, add_command, run_command

_REPORT, _WORKBOOK = "workbook.report.commands", "workbook.commands"
_COMMANDS = {
    "run": (_WORKBOOK, "execute notebooks, in order; all if none is named"),
    "collect": (_WORKBOOK, "write verdicts.csv, claims.csv and provenance.json from the outcomes"),
    "check": (_REPORT, "print the tables with their verdicts; exit 1 if a cell differs unexpectedly"),
    "report": (_REPORT, "write results/report.html, the notebooks' pages and errata.md"),
    "article": (_REPORT, "typeset results/article.pdf from article/article.typ and the results"),
    "readme": (_REPORT, "write the results' numbers into README.md"),
    "show": (_REPORT, "print a cell, an element, a claim or an erratum with its verdict and reason"),
    "diff": (_REPORT, "list cells and claims whose value or verdict changed since the last commit"),
    "lab": (_WORKBOOK, "copy the notebooks to lab/ for changes"),
    "data": (_WORKBOOK, "fetch and verify the authors' data"),
}


def main(arguments: list[str] | None = None) -> int:
    """Run one command of the workbook."""
    parser = OneLineParser(prog="python -m workbook", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command_name")
    made = {name: add_command(commands, name, *command) for name, command in _COMMANDS.items()}
    for name in ("run", "collect", "check", "report"):
        made[name].add_argument("--quick", action="store_true", help="few repeats; results go to results/quick")
    run, show = made["run"], made["show"]
    run.add_argument("notebook", nargs="*", type=Path, help="a notebook's .py source")
    run.add_argument("--stamps", type=Path, help="write <notebook>.done and <notebook>.d into this folder")
    run.add_argument("--watch", type=int, help="end when this process (make) has ended")
    minutes, text = float(os.environ.get("STALL_MINUTES") or 15), "minutes without progress that end a notebook"
    run.add_argument("--stall-minutes", type=float, default=minutes, help=f"{text} (default: STALL_MINUTES, or 15)")
    made["check"].add_argument("--strict", action="store_true", help="exit 1 if any cell differs, expected or not")
    show.add_argument("name", help="for example table2.row03.sd, 'Table 2', local_minima or E3")
    show.add_argument("--rerun", action="store_true", help="compute it again and print both")
    which = made["diff"].add_mutually_exclusive_group()
    which.add_argument("--quick", action="store_const", dest="made", const="quick", help="compare the quick run")
    which.add_argument("--lab", action="store_const", dest="made", const="lab", help="compare the notebooks in lab/")
    return run_command(parser, arguments, anywhere=("data",))
