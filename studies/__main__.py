"""The studies that take long: `python -m studies NAME` writes the tables of one."""

import argparse
import os
import sys
from collections.abc import Sequence

from replication.compilation import pinned_environment
from replication.files import ROOT, write_json, write_kept, write_text

RESULTS = ROOT / "results"


def write_claims() -> None:
    """The slow studies behind claims: results/alpha_refit.csv, noise_by_turns.csv and optimizers.csv."""
    from studies import edge, experiments, optimizers

    write_kept(RESULTS / "alpha_refit.csv", edge.refit_alphas())
    errors = experiments.kept_noise_errors(range(1, experiments.NOISES + 1))
    write_kept(RESULTS / "noise_by_turns.csv", errors)
    runs = optimizers.run_jobs(optimizers.planned_runs())
    write_kept(RESULTS / "optimizers.csv", runs)
    print(optimizers.success_table(runs).to_string(index=False))


def write_engine() -> None:
    """The paper's joint in a physics engine, and what the sensor says of its logs, into results/engine.csv."""
    from studies import engine

    write_kept(RESULTS / "engine.csv", engine.measure_all())
    _write_sheet()


def write_hardware() -> None:
    """What the sensor says of logs of real joints, into results/hardware.csv."""
    from studies import hardware

    write_kept(RESULTS / "hardware.csv", hardware.measure_all())


def write_joint() -> None:
    """The simulated joint anew from the authors' records, into replication/data/joint.json."""
    from studies.identification import reidentify_joint

    write_json(ROOT / "replication" / "data" / "joint.json", reidentify_joint())


def write_datasheet() -> None:
    """What the sensor says of simulated joints, once with a new seed, into results/datasheet.csv and its page."""
    from studies import datasheet

    sheet = datasheet.summarise(datasheet.measure_all())
    write_kept(RESULTS / "datasheet.csv", sheet)
    _write_sheet()
    print(sheet.to_string(index=False))


def _write_sheet() -> None:
    """The datasheet's page, by its table and the engine's."""
    from pandas import read_csv

    from studies import datasheet

    sheet, rows = (read_csv(RESULTS / f"{name}.csv") for name in ("datasheet", "engine"))
    page = datasheet.write_page(sheet, datasheet.summarise_engine(rows))
    write_text(ROOT / "notebooks" / "datasheet.md", page)


def write_prediction() -> None:
    """The prediction of Table 2, whichever way it falls, into results/table2_prediction.csv."""
    from studies import prediction

    write_kept(RESULTS / "table2_prediction.csv", prediction.run_prediction())


def write_realisations() -> None:
    """Table 2 again and again under each of its settings, into results/table2_realisations.csv; it resumes."""
    from studies.realisations import make_realisations

    make_realisations()


def write_starts() -> None:
    """Why the means are too small where a start is drawn for each row, into results/table2_starts.csv."""
    from studies import starts

    for table in starts.measure_rows(starts.planned_rows()):
        write_kept(RESULTS / "table2_starts.csv", table)


def write_refusals() -> None:
    """What each rule of reading refuses of sound logs and of faulty ones, into results/refusals.csv."""
    from studies import refusals

    write_kept(RESULTS / "refusals.csv", refusals.measure_all())


STUDIES = {
    "claims": write_claims,
    "datasheet": write_datasheet,
    "engine": write_engine,
    "hardware": write_hardware,
    "identify-joint": write_joint,
    "prediction": write_prediction,
    "realisations": write_realisations,
    "starts": write_starts,
    "refusals": write_refusals,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one study and return the exit status: 0 done, 2 the name or the data are not there, 1 anything else."""
    parser = argparse.ArgumentParser(prog="python -m studies", description=__doc__)
    parser.add_argument("name", nargs="?", default="", help=", ".join(STUDIES))
    name = parser.parse_args(arguments).name
    if name not in STUDIES:
        print(f"study {name!r}: there are {', '.join(STUDIES)}", file=sys.stderr)
        return 2
    os.environ |= pinned_environment()  # tests make rows again, and have to find the same digits
    try:
        STUDIES[name]()
    except Exception as error:
        # Of errors whose message is the one line that a user needs.
        if not hasattr(error, "exit_status"):
            raise
        print(error, file=sys.stderr)
        return error.exit_status
    return 0


if __name__ == "__main__":
    sys.exit(main())
