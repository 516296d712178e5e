"""The tables that `make all` does not make: the study that writes each, and how a row of one is made again.

`python -m studies.kept TABLE:POSITION,POSITION... TABLE...` makes rows again, or one, and prints them as the table has
them: behaviour decides whether a kept table is still what today's code makes. Its environment is `pinned_environment`.
"""

import sys
from collections.abc import Callable
from inspect import signature
from io import BytesIO
from typing import Any, NamedTuple

from pandas import DataFrame, concat, read_csv

from replication.files import ROOT, UserError, as_csv, write_json, write_kept, write_text
from studies import datasheet, edge, engine, experiments, hardware, optimizers, refusals, starts
from studies.datasheet import summarise, summarise_engine
from studies.identification import reidentify_joint
from studies.prediction import run_prediction
from studies.realisations import make_realisations, realise

RESULTS = ROOT / "results"


class Kept(NamedTuple):
    """A table's study, what makes it, and what makes rows of it again, from the columns that its arguments name."""

    study: str
    make: Callable[[], DataFrame]
    remake: Callable[..., Any]  # gives a row, or some, among which it is
    first: int = 0  # position of the row that each test run makes again


KEPT = {
    "table2_realisations": Kept("realisations", make_realisations, realise),
    "table2_prediction": Kept("prediction", run_prediction, lambda row: run_prediction([row])),
    "table2_starts": Kept(
        "starts", lambda: starts.measure_rows(starts.planned_rows()), starts.measure_row
    ),
    # The sharpest edge; at a softer one all sharper ones come before it.
    "alpha_refit": Kept("claims", edge.refit_alphas, lambda alpha: edge.refit_alphas(alpha)),
    "noise_by_turns": Kept(
        "claims",
        lambda: experiments.noise_errors_by_turns(range(1, experiments.NOISES + 1)),
        lambda noise: experiments.noise_errors_by_turns([noise]),
    ),
    "optimizers": Kept(
        "claims",
        lambda: optimizers.run_jobs(optimizers.planned_runs()),
        optimizers.run_on_authors_record,
    ),
    "datasheet": Kept(
        "datasheet",
        lambda: summarise(datasheet.measure_all()),
        lambda population: summarise(datasheet.measure_all([population])),
        -1,
    ),
    "hardware": Kept("hardware", hardware.measure_all, hardware.measure_log),
    "refusals": Kept("refusals", refusals.measure_all, refusals.measure_all),
    "engine": Kept("engine", engine.measure_all, engine.measure_log, 3),
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
    """Make rows of a kept table again, as CSV: of each row that is made the one that is most like the kept one."""
    table = read_csv(RESULTS / f"{name}.csv").astype(object)
    function = KEPT[name].remake
    arguments = table.columns.intersection([*signature(function).parameters])
    rows = []
    for position in positions:
        made = function(**table.loc[table.index[position], arguments].to_dict())
        frame = DataFrame([made] if isinstance(made, dict) else made)
        again, kept = (
            read_csv(BytesIO(as_csv(each)), dtype=str, na_filter=False)
            for each in (frame.reindex(columns=table.columns), table.iloc[[position]])
        )
        most_like = (again == kept.loc[0]).sum(axis=1).idxmax()
        rows.append(again.loc[[most_like]])
    return as_csv(concat(rows))


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        name, _, positions = argument.partition(":")
        if name in TIMED:
            sys.exit("times of a day and a machine")
        positions = positions or str(KEPT[name].first)
        sys.stdout.buffer.write(remake(name, [*map(int, positions.split(","))]))
