"""The command line: the virtual sensor on logs, and what the Makefile does, where there is no make."""

import argparse
import os
import sys
from pathlib import Path

from replication import workbook
from replication.data.authors import WORKBOOK_FILES, DataCorrupt, DataUnavailable, authors_file
from replication.report import commands as report
from replication.sensor import commands
from replication.sensor.tables import UnusableLog
from replication.simulator.simulate import identified_joint
from replication.simulator.study import FIT_LEVELS, calibrate, clean_records
from replication.studies import edge, optimizers, population, protocols, scoreboard, timings
from replication.workbook import files, provenance


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

    collect = subparsers.add_parser("collect", help="verdicts.csv, claims.csv and provenance.json from the outcomes")
    collect.add_argument("--quick", action="store_true", help="of the quick run")
    collect.set_defaults(command=_collect)
    report.add_commands(subparsers)
    for name, command, text in (
        ("identify-joint", _identify_joint, "identify the simulated joint anew, into data/joint.json"),
        ("claims", _claims, "the slow studies behind claims, into results/optimizers.csv and results/alpha_refit.csv"),
        ("bench", _bench, "time what was made fast, into results/bench.csv"),
        ("scoreboard", _scoreboard, "score every method, into results/scoreboard.csv"),
        ("population", _population, "every method on joints that nobody calibrated, into results/population_logs.csv"),
        ("data", _data, "fetch and verify the authors' data"),
    ):
        subparsers.add_parser(name, help=text).set_defaults(command=command)
    pools = subparsers.add_parser("protocols", help="runs of every candidate protocol, into results/protocols")
    pools.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    pools.set_defaults(command=_protocols)
    score = subparsers.add_parser("score", help="score your own method on the scoreboard's logs")
    score.add_argument("method", help="module:function; takes a Recording, returns the backlash [rad]")
    score.set_defaults(command=_score)
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


def _collect(options: argparse.Namespace) -> int:
    provenance.collect(report.results_folder(options.quick))
    return 0


def _identify_joint(_: argparse.Namespace) -> int:
    files.write_text(workbook.ROOT / "replication" / "data" / "joint.json", calibrate())
    return 0


def _claims(_: argparse.Namespace) -> int:
    results, clean = workbook.ROOT / "results", clean_records(FIT_LEVELS)
    files.write_csv(results / "alpha_refit.csv", edge.refit_alphas(identified_joint(), clean, edge.ALPHAS))
    if not optimizers.swarms_installed():
        print("the swarms need the extra `studies` (pip install .[studies]): optimizers.csv is kept", file=sys.stderr)
        return 1
    runs = optimizers.run_all(optimizers.plan())
    files.write_csv(results / "optimizers.csv", runs)
    print(optimizers.success_table(runs).to_string(index=False))
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


def _population(_: argparse.Namespace) -> int:
    drawn = population.measure_population(*population.SPREAD_STUDY)
    files.write_csv(workbook.ROOT / "replication" / "data" / "spread_of_joints.csv", population.spread_shares(drawn))
    rows = population.run_study(population.FINAL_SIZES, population.FINAL_SEED)
    files.write_csv(workbook.ROOT / "results" / "population_logs.csv", rows)
    print(population.summary(rows).to_string(index=False))
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


def _protocols(options: argparse.Namespace) -> int:
    protocols.compute_pools(jobs=options.jobs, tell=lambda line: print(line, flush=True))
    return 0


def _data(_: argparse.Namespace) -> int:
    for path in WORKBOOK_FILES:
        print(authors_file(path))
    return 0
