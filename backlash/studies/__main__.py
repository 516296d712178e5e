"""The studies' command line: each writes its table into the results."""

import argparse
import os
import sys

from replication import files
from replication.commands.parser import OneLineParser, add_command, run_command

_HERE = "backlash.studies.__main__"
_RESULTS, _DATA = files.ROOT / "results", files.ROOT / "backlash" / "data"


def main(arguments: list[str] | None = None) -> int:
    """Run one study."""
    parser = OneLineParser(prog="python -m backlash.studies", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command_name")
    for run in (run_calibrations, run_claims, run_scoreboard, run_population):
        add_command(commands, run.__name__.removeprefix("run_"), _HERE, run.__doc__ or "")
    runs = add_command(commands, "protocols", _HERE, "runs of every candidate protocol, into protocol_runs.csv")
    runs.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    score = add_command(commands, "score", _HERE, "score your own method on the scoreboard's logs")
    score.add_argument("method", help="module:function; takes a Recording, returns the backlash [rad]")
    return run_command(parser, arguments, anywhere=())


def run_calibrations(_: argparse.Namespace) -> int:
    """The sensor's default calibrations anew, into backlash/data/default_calibrations.json."""
    from backlash.calibration import default_calibrations_text

    files.write_text(_DATA / "default_calibrations.json", default_calibrations_text())
    return 0


def run_claims(_: argparse.Namespace) -> int:
    """The slow studies behind claims, into results/optimizers.csv and results/alpha_refit.csv."""
    from backlash.studies import optimizers
    from replication.simulator import edge

    files.write_csv(_RESULTS / "alpha_refit.csv", edge.refit_alphas())
    if not optimizers.swarms_installed():
        print("the swarms need the extra `studies` (pip install .[studies]): optimizers.csv is kept", file=sys.stderr)
        return 1
    runs = optimizers.run_jobs(optimizers.planned_runs())
    files.write_csv(_RESULTS / "optimizers.csv", runs)
    print(optimizers.success_table(runs).to_string(index=False))
    return 0


def run_scoreboard(_: argparse.Namespace) -> int:
    """Score every method, into results/scoreboard.csv."""
    from backlash.studies import scoreboard

    scores = scoreboard.score_all()
    table = scoreboard.summary(scores)
    files.write_csv(_RESULTS / "scoreboard_logs.csv", scores.drop(columns="seconds"))
    files.write_csv(_RESULTS / "scoreboard.csv", table)
    print(table.to_string(index=False))
    return 0


def run_population(_: argparse.Namespace) -> int:
    """Every method on joints that nobody calibrated, into results/population_logs.csv."""
    from backlash.studies import benchmark, population

    drawn = population.measure_population(*population.SPREAD_STUDY)
    files.write_csv(_DATA / "spread_of_joints.csv", population.spread_shares(drawn))
    rows = population.measure_final_logs()
    files.write_csv(_RESULTS / "population_logs.csv", rows)
    print(benchmark.summarise_intervals(rows).to_string(index=False))
    sheet = population.summarise_sensor(population.measure_sensor(population.DATASHEET, population.DATASHEET_SEED))
    files.write_csv(_RESULTS / "datasheet.csv", sheet)
    print(f"{sheet.to_string(index=False)}\n{population.against_criteria(sheet).to_string(index=False)}")
    return 0


def run_score(options: argparse.Namespace) -> int:
    """Score a user's method, without the authors' logs where they are not to be had."""
    from backlash.studies import scoreboard
    from replication.data.authors import DataUnavailable

    logs, missing = scoreboard.simulated_logs(False) + scoreboard.simulated_logs(True), ""
    try:
        logs = scoreboard.authors_logs() + logs
    except DataUnavailable as error:
        missing = f"without the authors' logs: {error}\n"
    scores = scoreboard.score_logs(options.method, scoreboard.load_method(options.method), logs)
    for kind, part in [*scores.groupby("kind", sort=False), ("all", scores)]:
        print(f"{kind}:\n{scoreboard.summary(part).to_string(index=False)}")
    sys.stderr.write(missing)
    return 0


def run_protocols(options: argparse.Namespace) -> int:
    """Run every candidate protocol."""
    from backlash.studies import protocols
    from replication.workbook.execution import PINNED_ENVIRONMENT

    os.environ.update(PINNED_ENVIRONMENT)  # the slow test that runs some again has to find the same digits
    protocols.compute_runs(options.jobs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
