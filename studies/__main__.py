"""The studies' command line: each writes its tables into the results."""

import argparse
import os
import sys

from replication import files
from workbook.parser import OneLineParser, add_command, run_command

_RESULTS, _DATA = files.ROOT / "results", files.ROOT / "backlash" / "data"


def main(arguments: list[str] | None = None) -> int:
    """Run one study."""
    parser = OneLineParser(prog="python -m studies", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command_name")
    for run in (run_calibrations, run_claims, run_population, run_protocols):
        add_command(commands, run.__name__.removeprefix("run_"), "studies.__main__", run.__doc__ or "")
    return run_command(parser, arguments, anywhere=())


def run_calibrations(_: argparse.Namespace) -> int:
    """The sensor's default calibrations anew, into backlash/data/default_calibrations.json."""
    from backlash.calibration import default_calibrations_text

    files.write_text(_DATA / "default_calibrations.json", default_calibrations_text())
    return 0


def run_claims(_: argparse.Namespace) -> int:
    """The slow studies behind claims, into results/optimizers.csv and results/alpha_refit.csv."""
    from replication.simulator import edge
    from studies import optimizers

    files.write_csv(_RESULTS / "alpha_refit.csv", edge.refit_alphas())
    if not optimizers.swarms_installed():
        print("the swarms need the extra `studies` (pip install .[studies]): optimizers.csv is kept", file=sys.stderr)
        return 1
    runs = optimizers.run_jobs(optimizers.planned_runs())
    files.write_csv(_RESULTS / "optimizers.csv", runs)
    print(optimizers.success_table(runs).to_string(index=False))
    return 0


def run_population(_: argparse.Namespace) -> int:
    """Every method on joints that nobody calibrated, into results/population_logs.csv and results/datasheet.csv."""
    import pandas as pd

    from studies import benchmark, population

    drawn = population.measure_population(*population.SPREAD_STUDY)
    files.write_csv(_DATA / "spread_of_joints.csv", population.spread_shares(drawn))
    studies = [population.measure_population(*study) for study in population.FINAL_STUDIES]
    rows = pd.concat(studies, ignore_index=True)
    files.write_csv(_RESULTS / "population_logs.csv", rows)
    print(benchmark.summarise_intervals(rows).to_string(index=False))
    sheet = population.summarise_sensor(population.measure_sensor(population.DATASHEET, population.DATASHEET_SEED))
    files.write_csv(_RESULTS / "datasheet.csv", sheet)
    print(f"{sheet.to_string(index=False)}\n{population.against_criteria(sheet).to_string(index=False)}")
    return 0


def run_protocols(_: argparse.Namespace) -> int:
    """Every protocol that may have printed Table 2, into results/protocol_runs.csv."""
    from replication.replay import protocols
    from workbook.execution import PINNED_ENVIRONMENT

    os.environ.update(PINNED_ENVIRONMENT)  # the slow test that runs some again has to find the same digits
    files.write_csv(protocols.RUNS, protocols.compute_runs())
    return 0


if __name__ == "__main__":
    sys.exit(main())
