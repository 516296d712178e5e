"""The command line: the virtual sensor on logs, and what the Makefile does, where there is no make."""

import argparse
import os
import sys
from pathlib import Path

from replication import workbook
from replication.data.authors import WORKBOOK_FILES, DataCorrupt, DataUnavailable, authors_file
from replication.report import flips
from replication.report import page as report
from replication.sensor import commands
from replication.sensor.tables import UnusableLog
from replication.simulator.study import calibrate
from replication.studies import scoreboard, sensitivity, timings
from replication.workbook import files, judging, provenance


def main(arguments: list[str] | None = None) -> int:
    """Run one command; return its exit status: 0 done, 2 the input is not usable, 1 anything else."""
    options = _parser().parse_args(arguments)
    try:
        return options.command(options)
    except (DataUnavailable, DataCorrupt, UnusableLog, scoreboard.UnusableMethod) as error:
        print(error, file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = commands.OneLineParser(prog="python -m replication", description=__doc__)
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    commands.add_commands(subparsers)

    run = subparsers.add_parser("run", help="execute notebooks, in order; all of them if none is named")
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
    run.set_defaults(command=_run)

    for name, command, text in (
        ("collect", _collect, "verdicts.csv, claims.csv and provenance.json from the notebooks' outcomes"),
        ("check", _check, "print the verdict table; exit 1 if any cell differs"),
        ("report", _report, "results/report.html from the results"),
    ):
        sub = subparsers.add_parser(name, help=text)
        sub.add_argument("--quick", action="store_true", help="of the quick run")
        sub.set_defaults(command=command)
    diff = subparsers.add_parser("diff", help="cells and claims whose verdict is not that of the last commit's results")
    made = diff.add_mutually_exclusive_group()
    made.add_argument("--quick", action="store_const", dest="made", const="quick", help="of the quick run")
    made.add_argument("--lab", action="store_const", dest="made", const="lab", help="of notebooks run by hand")
    diff.set_defaults(command=_diff)
    subparsers.add_parser("readme", help="write the results' numbers into README.md").set_defaults(command=_readme)
    subparsers.add_parser(
        "sensitivity", help="who notices a wrong constant, into results/sensitivity.csv"
    ).set_defaults(command=_sensitivity)
    subparsers.add_parser(
        "identify-joint", help="identify the simulated joint anew, into data/joint.json"
    ).set_defaults(command=_identify_joint)
    subparsers.add_parser("bench", help="time what was made fast, into results/bench.csv").set_defaults(command=_bench)
    subparsers.add_parser("scoreboard", help="score every method, into results/scoreboard.csv").set_defaults(
        command=_scoreboard
    )
    score = subparsers.add_parser("score", help="score your own method on the scoreboard's logs")
    score.add_argument("method", help="module:function; takes a Recording, returns the backlash [rad]")
    score.set_defaults(command=_score)
    subparsers.add_parser("data", help="fetch and verify the authors' data").set_defaults(command=_data)
    return parser


def _run(options: argparse.Namespace) -> int:
    from replication.workbook import running  # takes a second and a half, which no other command should wait for

    sources = options.notebook or sorted((workbook.ROOT / "notebooks").glob("[0-9]*.py"))
    try:
        endings = running.run(sources, options.quick, options.stamps, 60 * options.stall_minutes, options.watch)
    except KeyboardInterrupt:
        print("interrupted; what was finished is kept", file=sys.stderr)
        return 130
    failed = [ending.why for ending in endings if ending.how == "failed"]
    if not options.quick:
        running.note_run(endings)
    print("\n".join([running.slowest_cells(endings), *(f"failed: {why}" for why in failed)]), file=sys.stderr)
    return 1 if failed else 0


def _results(options: argparse.Namespace) -> Path:
    return (workbook.QUICK if options.quick else workbook.ROOT) / "results"


def _collect(options: argparse.Namespace) -> int:
    provenance.collect(_results(options))
    return 0


def _check(options: argparse.Namespace) -> int:
    table = judging.verdicts(_results(options))
    print(judging.verdict_text(table))
    for notebook, changed in provenance.stale(_results(options)).items():
        print(f"stale: {notebook}: changed since: {', '.join(changed)}")
    return 1 if (table["verdict"] == "differs").any() else 0


def _report(options: argparse.Namespace) -> int:
    print(report.write_page(_results(options)))
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


def _sensitivity(_: argparse.Namespace) -> int:
    table = sensitivity.sensitivity()
    files.write_csv(workbook.ROOT / "results" / "sensitivity.csv", table)
    print(table.groupby(["constant", "changed"], sort=False)["group"].agg(lambda g: (g != "").sum()).to_string())
    return 0


def _readme(_: argparse.Namespace) -> int:
    report.update_readme(workbook.ROOT / "README.md", workbook.ROOT / "results")
    return 0


def _identify_joint(_: argparse.Namespace) -> int:
    files.write_text(workbook.ROOT / "replication" / "data" / "joint.json", calibrate())
    return 0


def _bench(_: argparse.Namespace) -> int:
    table = timings.bench()
    files.write_csv(workbook.ROOT / "results" / "bench.csv", table)
    print(table.drop(columns="note").to_string(index=False))
    return 0


def _scoreboard(_: argparse.Namespace) -> int:
    scores = scoreboard.score_all(scoreboard.scoreboard_logs())
    table = scoreboard.summary(scores)
    folder = workbook.ROOT / "results"
    files.write_csv(folder / "scoreboard_logs.csv", scores.drop(columns="seconds"))
    files.write_csv(folder / "scoreboard.csv", table)
    print(table.to_string(index=False))
    return 0


def _score(options: argparse.Namespace) -> int:
    logs, missing = scoreboard.logs_at_hand()
    scores = scoreboard.score_logs(options.method, scoreboard.load_method(options.method), logs)
    for kind, part in scores.groupby("kind", sort=False):
        print(f"{kind}:\n{scoreboard.summary(part).to_string(index=False)}")
    print(f"all:\n{scoreboard.summary(scores).to_string(index=False)}")
    if missing:
        print(missing, file=sys.stderr)
    return 0


def _data(_: argparse.Namespace) -> int:
    for path in WORKBOOK_FILES:
        print(authors_file(path))
    return 0
