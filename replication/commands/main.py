"""The command line: the virtual sensor on logs, and what the Makefile does, where there is no make."""

import argparse
import os
import sys
from pathlib import Path

from replication.commands.parser import OneLineParser, add_command, run_command
from replication.sensor.options import add_sensor_commands

_REPORT = "replication.report.commands"
_WORKBOOK, _STUDIES = "replication.commands.workbook", "replication.commands.studies"

# Commands without options, and those whose only option is --quick.
_PLAIN = {
    "data": (_WORKBOOK, "fetch and verify the authors' data"),
    "article": (_REPORT, "results/article.pdf from article/article.typ and the results"),
    "readme": (_REPORT, "write the results' numbers into README.md"),
    "identify-joint": (_STUDIES, "identify the simulated joint anew, into data/joint.json"),
    "calibrations": (_STUDIES, "the sensor's default calibrations anew, into data/default_calibrations.json"),
    "claims": (_STUDIES, "the slow studies behind claims, into results/optimizers.csv and results/alpha_refit.csv"),
    "bench": (_STUDIES, "time what was made fast, into results/bench.csv"),
    "scoreboard": (_STUDIES, "score every method, into results/scoreboard.csv"),
    "population": (_STUDIES, "every method on joints that nobody calibrated, into results/population_logs.csv"),
}
_WITH_QUICK = {
    "collect": (_WORKBOOK, "verdicts.csv, claims.csv and provenance.json from the outcomes"),
    "check": (_REPORT, "print the tables with their verdicts; exit 1 if a cell differs unexpectedly"),
    "report": (_REPORT, "results/report.html, the notebooks' pages and errata.md"),
}

ANYWHERE = ("estimate", "calibrate", "trend", "data")  # commands that need no checkout of the project


def main(arguments: list[str] | None = None) -> int:
    """Run one command; return its exit status: 0 done, 2 the input is not usable, 1 anything else."""
    options = _parser().parse_args(arguments)
    try:
        if options.command_name not in ANYWHERE:
            from replication.workbook.files import require_checkout  # what the sensor does not wait for

            require_checkout()
        return run_command(options)
    except Exception as error:
        if not hasattr(error, "exit_status"):  # of errors whose message is the one line that a user needs
            raise
        print(error, file=sys.stderr)
        return error.exit_status


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(prog="python -m replication", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command_name")
    add_sensor_commands(commands)
    made = {name: add_command(commands, name, *rest) for name, rest in (_WITH_QUICK | _PLAIN).items()}
    for name in _WITH_QUICK:
        made[name].add_argument("--quick", action="store_true", help="of the quick run")
    made["check"].add_argument("--strict", action="store_true", help="exit 1 if any cell differs, expected or not")
    _add_run_options(add_command(commands, "run", _WORKBOOK, "execute notebooks, in order; all if none is named"))

    show = add_command(commands, "show", _REPORT, "a cell, an element or a claim: printed, ours, verdict and why")
    show.add_argument("name", help="such as table2.row03.sd, 'Table 2', local_minima or E3")
    show.add_argument("--rerun", action="store_true", help="make just that again, and show it beside")
    diff = add_command(commands, "diff", _REPORT, "cells and claims whose value or verdict is not the last commit's")
    which = diff.add_mutually_exclusive_group()
    which.add_argument("--quick", action="store_const", dest="made", const="quick", help="of the quick run")
    which.add_argument("--lab", action="store_const", dest="made", const="lab", help="of notebooks run by hand")
    runs = add_command(commands, "protocols", _STUDIES, "runs of every candidate protocol, into protocol_runs.csv")
    runs.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    score = add_command(commands, "score", _STUDIES, "score your own method on the scoreboard's logs")
    score.add_argument("method", help="module:function; takes a Recording, returns the backlash [rad]")
    return parser


def _add_run_options(run: argparse.ArgumentParser) -> None:
    run.add_argument("notebook", nargs="*", type=Path, help="a notebook's .py source")
    run.add_argument("--quick", action="store_true", help="few repeats, into results/quick")
    run.add_argument("--stamps", type=Path, help="leave <notebook>.done and <notebook>.d in this folder")
    run.add_argument("--watch", type=int, help="end when this process, make, is gone")
    run.add_argument(
        "--stall-minutes",
        type=float,
        default=float(os.environ.get("STALL_MINUTES") or 15),
        help="end a notebook after so long without progress (default: STALL_MINUTES, or 15)",
    )
