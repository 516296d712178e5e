"""Table 2 again and again, each time with a noise and seeds of its own, under each of its settings and starts.

`results/table2_realisations.csv` keeps the means and SDs, because they take hours.
"""

from dataclasses import replace

import numpy as np
from numpy.random import Generator, default_rng
from pandas import DataFrame, read_csv

from replication import published
from replication.files import ROOT, check_kept
from replication.records import Recording, add_noise, constant_speed, load_clean, simulate_clean
from replication.table2 import (
    DRAWN_STARTS,
    LEVELS,
    NOISE_ROW,
    ROWS,
    RUNS,
    SETTINGS,
    WHOLE,
    SearchSettings,
    basin_labels,
    fit,
)

REALISATIONS = ROOT / "results" / "table2_realisations.csv"
PROTOCOLS = {settings.protocol: settings for settings in (*SETTINGS, *DRAWN_STARTS)}
STUDY_SEED = 2027
FIRST_SAMPLES = 100  # of which the text draws the start
NUMBER = 40  # of tables under each setting
NOISE_ROWS = 10  # of row 11, noise alone, with the whole record


def from_sample(recording: Recording, start: int) -> Recording:
    """Drop a record's first samples, so that its time starts from zero at sample `start`."""
    return replace(recording, t=recording.t[start:] - recording.t[start], v=recording.v[start:])


def draw_starts(settings: SearchSettings, realisation: int, rng: Generator) -> np.ndarray:
    """Draw the first samples of a row's thirty fits, for each fit, row or table; shape (30,)."""
    if settings.start == WHOLE:
        return np.zeros(RUNS, int)
    if settings.start == "per table":  # whose rows share a stream
        rng = default_rng((STUDY_SEED, *settings.protocol.encode(), realisation))
    drawn = rng.integers(FIRST_SAMPLES, size=RUNS if settings.start == "per fit" else 1)
    return np.broadcast_to(drawn, RUNS)


def draw_record(row: int, rng: Generator) -> Recording:
    """A row's clean record with a noise of the printed amplitude.

    Row 1's clean record is not public, so our joint's takes its place.
    """
    if row == NOISE_ROW:
        clean = constant_speed()
    else:
        level = LEVELS[row - 1]
        clean = simulate_clean(level) if row == 1 else load_clean(level)
    return add_noise(clean, published.column("Table 2", "noise")[row - 1], rng)


def noisy_records(
    settings: SearchSettings, row: int, realisation: int
) -> list[tuple[Recording, int]]:
    """Draw a noise, and of each of a row's thirty fits the record and the seed; no other settings have the same."""
    rng = default_rng((STUDY_SEED, *settings.protocol.encode(), realisation, row))
    record = draw_record(row, rng)
    starts = draw_starts(settings, realisation, rng)
    seeds = rng.integers(1, 2**31, RUNS)
    cut = [from_sample(record, start) for start in starts.tolist()]
    return list(zip(cut, seeds.tolist(), strict=True))


def realise(protocol: str, row: int, realisation: int) -> dict[str, object]:
    """Make one row of Table 2 again: the mean and SD [rps] over thirty runs, and the best basin's share of them."""
    settings = PROTOCOLS[protocol]
    records = noisy_records(settings, row, realisation)
    fits = [fit(record, settings, seed) for record, seed in records]
    A = np.array([each.X.A if row == NOISE_ROW else each.amplitude_rps for each in fits])
    in_best = basin_labels(np.array([each.rmse for each in fits])) == 1
    return {
        "protocol": protocol,
        "realisation": realisation,
        "row": row,
        "mean_A_rps": A.mean(),
        "sd_A_rps": A.std(ddof=1),
        "best_basin_share": in_best.mean(),
    }


def read_realisations() -> DataFrame:
    """The realisations that are kept: the rows of `realise`."""
    check_kept(REALISATIONS)
    return read_csv(REALISATIONS)


def planned_rows() -> list[tuple[str, int, int]]:
    """List protocols, rows and realisations, as `realise` takes them."""
    return [
        (protocol, row, realisation)
        for realisation in range(1, NUMBER + 1)
        for protocol, settings in PROTOCOLS.items()
        for row in (*ROWS, NOISE_ROW)
        if row in ROWS or (settings.start == WHOLE and realisation <= NOISE_ROWS)
    ]
