"""The tables that `make all` does not make, each with the command that makes it; a row of one made again.

`python -m studies.kept TABLE:POSITION,POSITION... TABLE...` makes rows again, or one, under the settings that the
studies run under, and prints them as the table has them: behaviour decides whether a kept table is still what today's
code makes.
"""

import os
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

from replication.compilation import pinned_environment
from replication.files import ROOT, as_csv

Row = dict[str, Any]


class Kept(NamedTuple):
    """What makes a table, and what makes one row of it again, from the values that say which row it is."""

    command: str
    remake: Callable[[Row], Row]
    first: int = 0  # position of the row that each test run makes again


def remake_realisation(row: Row) -> Row:
    """Thirty runs of a row of Table 2 on one noise."""
    from studies import realisations

    settings = {
        each.protocol: each for each in (*realisations.SETTINGS, *realisations.DRAWN_STARTS)
    }
    return realisations.realise(settings[row["protocol"]], row["row"], row["realisation"])


def remake_prediction(row: Row) -> Row:
    """The runs of the prediction on one row of Table 2."""
    from studies import prediction

    return prediction.run_prediction([row["row"]]).iloc[0].to_dict()


def remake_start(row: Row) -> Row:
    """Thirty fits by one search on a row of Table 2, with the others on it."""
    from studies import starts

    rows = starts.measure_row(*(row[key] for key in ("noise", "settings", "start", "table", "row")))
    return next(each for each in rows if each["search"] == row["search"])


def remake_optimizer_run(row: Row) -> Row:
    """One run of a search."""
    from studies import optimizers

    return optimizers.run_on_authors_record(
        row["method"], row["level"], row["realisation"], row["seed"]
    )


def remake_alpha(row: Row) -> Row:
    """The joint identified at the sharpest edge; at a softer one all sharper ones come before it."""
    from studies import edge

    return edge.refit_alphas(row["alpha"]).iloc[-1].to_dict()


def remake_population(row: Row) -> Row:
    """What the sensor says of all logs of a population of the datasheet."""
    from studies import datasheet

    return datasheet.summarise(datasheet.measure_all([row["population"]])).iloc[0].to_dict()


def remake_rule(row: Row) -> Row:
    """What a rule of reading refuses."""
    from studies import refusals

    table = refusals.measure_all()
    return table[table["rule"] == row["rule"]].iloc[0].to_dict()


def remake_noise_error(row: Row) -> Row:
    """The error of one fit of some turns of a noisy record."""
    from studies import experiments

    table = experiments.kept_noise_errors([int(row["noise"])])
    same = (table["delta_rad"].round(9) == row["delta_rad"]) & (table["turns"] == row["turns"])
    return table[same].iloc[0].to_dict()


def remake_hardware(row: Row) -> Row:
    """What the sensor says of a log of a real joint."""
    from studies import hardware

    return hardware.measure_log(row["log"])


def remake_engine_log(row: Row) -> Row:
    """A run of the physics engine, and what the sensor says of it."""
    from studies import engine

    return engine.measure_log(row["population"], row["number"])


KEPT = {
    "table2_realisations": Kept("make studies NAME=realisations", remake_realisation),
    "table2_prediction": Kept("make studies NAME=prediction", remake_prediction),
    "table2_starts": Kept("make studies NAME=starts", remake_start),
    "optimizers": Kept("make studies NAME=claims", remake_optimizer_run),
    "noise_by_turns": Kept("make studies NAME=claims", remake_noise_error),
    "alpha_refit": Kept("make studies NAME=claims", remake_alpha),
    "datasheet": Kept("make studies NAME=datasheet", remake_population, -1),
    "hardware": Kept("make studies NAME=hardware", remake_hardware),
    "refusals": Kept("make studies NAME=refusals", remake_rule),
    "engine": Kept("make studies NAME=engine", remake_engine_log, 3),
}
# Seconds: of a day and a machine, which the tables name.
TIMED = {"peers": "make bench", "notebook_times": "make bench"}


def remake(name: str, positions: list[int]) -> bytes:
    """Make rows of a kept table again, as CSV."""
    import pandas as pd

    table = pd.read_csv(ROOT / "results" / f"{name}.csv")
    rows = [KEPT[name].remake(table.iloc[position].to_dict()) for position in positions]
    return as_csv(pd.DataFrame(rows).reindex(columns=table.columns))


if __name__ == "__main__":
    os.environ |= pinned_environment()
    for argument in sys.argv[1:]:
        name, _, positions = argument.partition(":")
        if name in TIMED:
            sys.exit("times of a day and a machine")
        positions = positions or str(KEPT[name].first)
        sys.stdout.buffer.write(remake(name, [*map(int, positions.split(","))]))
