"""The tables that `make all` does not make: the study that writes each, and how a row of one is made again.

`python -m studies.kept TABLE:POSITION,POSITION... TABLE...` makes rows again, or one, and prints them as the table has
them: behaviour decides whether a kept table is still what today's code makes. Its environment is `pinned_environment`.
"""

import sys
from collections.abc import Callable, Iterable, Iterator
from difflib import get_close_matches
from inspect import signature
from typing import Any, NamedTuple

from joblib import Parallel, delayed
from pandas import DataFrame, concat, read_csv

from replication.files import ROOT, UserError, as_csv, write_json, write_kept, write_text
from replication.table2 import ROWS
from studies import datasheet, edge, engine, experiments, hardware, optimizers, refusals, starts
from studies.datasheet import summarise_engine
from studies.identification import reidentify_joint
from studies.prediction import predict_row
from studies.realisations import planned_rows, realise

RESULTS = ROOT / "results"


class Kept(NamedTuple):
    """A table's study, what gives a row of it, or some, and with which arguments, named as its columns, each time."""

    study: str
    measure: Callable[..., Any]
    plan: Callable[[], Iterable[tuple[Any, ...]]]
    first: int = 0  # position of the row that each test run makes again


KEPT = {
    "table2_realisations": Kept("realisations", realise, planned_rows),
    "table2_prediction": Kept("prediction", predict_row, lambda: zip(ROWS)),
    "table2_starts": Kept("starts", starts.measure_row, starts.planned_rows),
    # The sharpest edge is made again; at a softer one all sharper ones come before it.
    "alpha_refit": Kept("claims", edge.refit_alphas, lambda: [edge.ALPHAS[-1:]]),
    "noise_by_turns": Kept("claims", experiments.measure_error, experiments.planned_errors),
    "optimizers": Kept("claims", optimizers.run_on_authors_record, optimizers.planned_runs),
    "datasheet": Kept(
        "datasheet", datasheet.measure_population, lambda: zip(datasheet.POPULATIONS), -1
    ),
    "hardware": Kept("hardware", hardware.measure_log, lambda: zip(hardware.list_logs().index)),
    "refusals": Kept("refusals", refusals.measure_all, lambda: [()]),
    "engine": Kept("engine", engine.measure_log, engine.planned_logs, 3),
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
            made = Parallel(n_jobs=-1)(delayed(kept.measure)(*each) for each in kept.plan())
            write_kept(RESULTS / f"{name}.csv", concat(map(as_frame, made)))
    if study in ("datasheet", "engine"):
        sheet, rows = (read_csv(RESULTS / f"{name}.csv") for name in ("datasheet", "engine"))
        page = datasheet.write_page(sheet, summarise_engine(rows))
        write_text(ROOT / "notebooks" / "datasheet.md", page)


def as_frame(made: Any) -> DataFrame:
    """The rows that a measurement gives, a dict each, or one, or already a frame."""
    return DataFrame([made] if isinstance(made, dict) else made)


def remake(name: str, positions: list[int]) -> Iterator[str]:
    """Make rows of a kept table again, as lines: of the rows that are made the one that is most like the kept one."""
    file = RESULTS / f"{name}.csv"
    table = read_csv(file).astype(object)
    measure = KEPT[name].measure
    arguments = table[table.columns.intersection([*signature(measure).parameters])]
    head, *kept = file.read_text("utf-8").splitlines()
    yield head
    for position in positions:
        made = as_frame(measure(**arguments.iloc[position].to_dict()))
        lines = as_csv(made.reindex(columns=table.columns)).decode().splitlines()
        yield from get_close_matches(kept[position], lines[1:], 1, 0.0)


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        name, _, positions = argument.partition(":")
        if name in TIMED:
            sys.exit("times of a day and a machine")
        positions = positions or str(KEPT[name].first)
        print(*remake(name, [*map(int, positions.split(","))]), sep="\n")
