"""The stand-in of the test bench: Table 3, and a population of benches around it."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from replication import characteristic, published
from replication.recording import Recording
from replication.standins.joints import (
    Bench,
    FitRecord,
    Spread,
    draw_bench,
    encoder_log,
    fitted_logs,
)
from replication.table2 import AUTHORS_PROTOCOL, repeated_fits, summarise_runs

# Table 3's cells, by their names among the printed ones, and our columns.
TABLE3_COLUMNS = {
    "known": "known_A_rps",
    "mean": "mean_A_rps",
    "sd": "sd_A_rps",
    "relative_error": "relative_error_percent",
}


def table3_records(
    bench: Bench, deltas_rad: Sequence[float], seed: int
) -> list[tuple[dict, Recording]]:
    """Measure and log the bench in each state of wear."""
    rng = np.random.default_rng(seed)
    records = []
    for row, delta in enumerate(deltas_rad, start=1):
        reading = delta + rng.normal(0.0, bench.dial_gauge_rad)
        known = characteristic.known_amplitude_rps(reading)
        key = {"row": row, "delta_rad": delta, "reading_rad": reading, "known_A_rps": known}
        records.append((key, encoder_log(bench, delta, rng)))
    return records


def fit_table3(bench: Bench, deltas_rad: Sequence[float], seed: int, repeats: int) -> pd.DataFrame:
    """Table 3 of a bench: the paper's search on its log in each state of wear, from so many seeds."""
    records = table3_records(bench, deltas_rad, seed)
    label = "Table 3, stand-in bench"
    return table3(repeated_fits(records, [AUTHORS_PROTOCOL], range(1, repeats + 1), label))


def table3(runs: pd.DataFrame) -> pd.DataFrame:
    """Condense the runs on the bench's records into Table 3, the printed columns beside."""
    keys = ["source", "row", "delta_rad", "reading_rad", "known_A_rps"]
    printed = {
        f"printed_{column}": published.column("Table 3", cell)
        for cell, column in TABLE3_COLUMNS.items()
    }
    return summarise_runs(runs.assign(source="stand-in"), keys).assign(**printed)


def table3_cells(table: pd.DataFrame) -> dict[str, float]:
    """Means and SDs of Table 3 by cell id, from `table3`."""
    rows = table.set_index("row")
    return {
        f"table3.row{row:02d}.{cell}": rows.at[row, TABLE3_COLUMNS[cell]]
        for row in rows.index
        for cell in ("mean", "sd")
    }


def bench_population(
    fit_record: FitRecord,
    benches: int,
    deltas_rad: Sequence[float],
    seed: int,
    spread: Spread | None = None,
) -> pd.DataFrame:
    """Fit the logs of many benches in each state: what the spread alone makes of Table 3."""
    drawn = [draw_bench(np.random.default_rng((seed, number)), spread) for number in range(benches)]
    cases = [(bench, delta) for bench in drawn for delta in deltas_rad]
    table = fitted_logs(fit_record, cases, [(seed, benches + index) for index in range(len(cases))])
    known = np.array([characteristic.known_amplitude_rps(delta) for delta in table["delta_rad"]])
    table.insert(0, "bench", np.repeat(np.arange(benches), len(deltas_rad)))
    return table.assign(error_percent=100 * (table["A_rps"] / known - 1))
