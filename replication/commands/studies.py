"""What the commands of studies do; each writes its results."""

import argparse
import os
import sys

from replication import workbook
from replication.methods.calibration import default_calibrations_text
from replication.simulator.simulate import identified_joint
from replication.simulator.study import FIT_LEVELS, clean_records, reidentify_joint
from replication.studies import edge, optimizers, population, protocols, scoreboard, timings
from replication.workbook import files


def run_identify_joint(_: argparse.Namespace) -> int:
    """Identify the simulated joint anew."""
    files.write_text(workbook.ROOT / "replication" / "data" / "joint.json", reidentify_joint())
    return 0


def run_calibrations(_: argparse.Namespace) -> int:
    """Compute the sensor's default calibrations anew."""
    path = workbook.ROOT / "replication" / "data" / "default_calibrations.json"
    files.write_text(path, default_calibrations_text())
    return 0


def run_claims(_: argparse.Namespace) -> int:
    """Run the slow studies behind claims."""
    results, clean = workbook.ROOT / "results", clean_records(FIT_LEVELS)
    files.write_csv(results / "alpha_refit.csv", edge.refit_alphas(identified_joint(), clean, edge.ALPHAS))
    if not optimizers.swarms_installed():
        print("the swarms need the extra `studies` (pip install .[studies]): optimizers.csv is kept", file=sys.stderr)
        return 1
    runs = optimizers.run_all(optimizers.plan())
    files.write_csv(results / "optimizers.csv", runs)
    print(optimizers.success_table(runs).to_string(index=False))
    return 0


def run_bench(_: argparse.Namespace) -> int:
    """Time what was made fast."""
    table = timings.bench()
    files.write_csv(workbook.ROOT / "results" / "bench.csv", table)
    print(table.drop(columns="note").to_string(index=False))
    return 0


def run_scoreboard(_: argparse.Namespace) -> int:
    """Score every method."""
    scores = scoreboard.score_all(scoreboard.scoreboard_logs())
    table = scoreboard.summary(scores)
    folder = workbook.ROOT / "results"
    files.write_csv(folder / "scoreboard_logs.csv", scores.drop(columns="seconds"))
    files.write_csv(folder / "scoreboard.csv", table)
    print(table.to_string(index=False))
    return 0


def run_population(_: argparse.Namespace) -> int:
    """Measure every method on joints that nobody calibrated."""
    drawn = population.measure_population(*population.SPREAD_STUDY)
    files.write_csv(workbook.ROOT / "replication" / "data" / "spread_of_joints.csv", population.spread_shares(drawn))
    rows = population.run_study(population.FINAL_SIZES, population.FINAL_SEED)
    files.write_csv(workbook.ROOT / "results" / "population_logs.csv", rows)
    print(population.summary(rows).to_string(index=False))
    return 0


def run_score(options: argparse.Namespace) -> int:
    """Score a user's method."""
    logs, missing = scoreboard.logs_at_hand()
    scores = scoreboard.score_logs(options.method, scoreboard.load_method(options.method), logs)
    for kind, part in scores.groupby("kind", sort=False):
        print(f"{kind}:\n{scoreboard.summary(part).to_string(index=False)}")
    print(f"all:\n{scoreboard.summary(scores).to_string(index=False)}")
    if missing:
        print(missing, file=sys.stderr)
    return 0


def run_protocols(options: argparse.Namespace) -> int:
    """Run every candidate protocol."""
    from replication.workbook.execution import PINNED_ENVIRONMENT  # as slow to import as `running`

    os.environ.update(PINNED_ENVIRONMENT)  # what runs there again, notebook 17, has to find the same to the last bit
    protocols.compute_runs(options.jobs)
    return 0
