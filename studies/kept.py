"""The tables that `make all` does not make: the study that writes each, and how a row of one is made again.

`python -m studies.kept TABLE:POSITION,POSITION... TABLE...` makes rows again, or one, and prints them as the table has
them: behaviour decides whether a kept table is still what today's code makes. Its environment is `pinned_environment`.
"""

import sys
from collections.abc import Callable
from typing import Any, NamedTuple

from pandas import DataFrame, read_csv

from replication.files import ROOT, UserError, as_csv, write_json, write_kept, write_text
from replication.table2 import DRAWN_STARTS, SETTINGS
from studies import datasheet, edge, engine, experiments, hardware, optimizers, refusals, starts
from studies.datasheet import summarise, summarise_engine
from studies.identification import reidentify_joint
from studies.prediction import run_prediction
from studies.realisations import make_realisations, realise

RESULTS = ROOT / "results"
Row = dict[str, Any]


class Kept(NamedTuple):
    """A table's study, what makes it, and what makes one row of it again, from the values that say which row it is."""

    study: str
    make: Callable[[], DataFrame]
    remake: Callable[[Row], Row]
    first: int = 0  # position of the row that each test run makes again


def remake_noise_error(row: Row) -> Row:
    """The error of one fit of some turns of a noisy record."""
    table = experiments.noise_errors_by_turns([int(row["noise"])])
    same = (table["delta_rad"].round(9) == row["delta_rad"]) & (table["turns"] == row["turns"])
    return last_row(table[same])


def remake_search(row: Row) -> Row:
    """One run of a search."""
    job = (row["method"], row["realisation"], row["level"], row["seed"])
    return optimizers.run_on_authors_record(*job)


def remake_realisation(row: Row) -> Row:
    """Thirty runs of a row of Table 2 on one noise."""
    settings = {each.protocol: each for each in (*SETTINGS, *DRAWN_STARTS)}
    return realise(settings[row["protocol"]], row["row"], row["realisation"])


def remake_start(row: Row) -> Row:
    """Thirty fits by one search on a row of Table 2, with the others on it."""
    rows = starts.measure_row(*(row[key] for key in ("noise", "settings", "table", "start", "row")))
    return next(each for each in rows if each["search"] == row["search"])


def remake_rule(row: Row) -> Row:
    """What a rule of reading refuses."""
    table = refusals.measure_all()
    return last_row(table[table["rule"] == row["rule"]])


def last_row(table: DataFrame) -> Row:
    """The last row of a table."""
    row: Row = table.iloc[-1].to_dict()
    return row


KEPT = {
    "table2_realisations": Kept("realisations", make_realisations, remake_realisation),
    "table2_prediction": Kept(
        "prediction", run_prediction, lambda row: last_row(run_prediction([row["row"]]))
    ),
    "table2_starts": Kept(
        "starts", lambda: starts.measure_rows(starts.planned_rows()), remake_start
    ),
    # The sharpest edge; at a softer one all sharper ones come before it.
    "alpha_refit": Kept(
        "claims", edge.refit_alphas, lambda row: last_row(edge.refit_alphas(row["alpha"]))
    ),
    "noise_by_turns": Kept(
        "claims",
        lambda: experiments.noise_errors_by_turns(range(1, experiments.NOISES + 1)),
        remake_noise_error,
    ),
    "optimizers": Kept(
        "claims", lambda: optimizers.run_jobs(optimizers.planned_runs()), remake_search
    ),
    "datasheet": Kept(
        "datasheet",
        lambda: summarise(datasheet.measure_all()),
        lambda row: last_row(summarise(datasheet.measure_all([row["population"]]))),
        -1,
    ),
    "hardware": Kept(
        "hardware", hardware.measure_all, lambda row: hardware.measure_log(row["log"])
    ),
    "refusals": Kept("refusals", refusals.measure_all, remake_rule),
    "engine": Kept(
        "engine",
        engine.measure_all,
        lambda row: engine.measure_log(row["population"], row["number"]),
        3,
    ),
}
STUDIES = sorted({"identify-joint", *(kept.study for kept in KEPT.values())})
TIMED = ("peers", "notebook_times")  # seconds, of a day and a machine, by `make bench`


def write_study(study: str) -> None:
    """Write the tables of a study, or the joint identified anew, and the datasheet's page."""
    if study not in STUDIES:
        raise UserError(f"study {study!r}: there are {', '.join(STUDIES)}")
    if study == "identify-joint":
        write_json(ROOT / "replication" / "data" / "joint.json", reidentify_joint())
    for name, kept in KEPT.items():
        if kept.study == study:
            write_kept(RESULTS / f"{name}.csv", kept.make())
    if study in ("datasheet", "engine"):
        sheet, rows = (read_csv(RESULTS / f"{name}.csv") for name in ("datasheet", "engine"))
        page = datasheet.write_page(sheet, summarise_engine(rows))
        write_text(ROOT / "notebooks" / "datasheet.md", page)


def remake(name: str, positions: list[int]) -> bytes:
    """Make rows of a kept table again, as CSV."""
    table = read_csv(RESULTS / f"{name}.csv")
    rows = [KEPT[name].remake(table.iloc[position].to_dict()) for position in positions]
    return as_csv(DataFrame(rows).reindex(columns=table.columns))


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        name, _, positions = argument.partition(":")
        if name in TIMED:
            sys.exit("times of a day and a machine")
        positions = positions or str(KEPT[name].first)
        sys.stdout.buffer.write(remake(name, [*map(int, positions.split(","))]))
