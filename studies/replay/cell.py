"""A cell of Table 2 from its row alone: `python -m studies.replay.cell ROW COLUMN`."""

import sys

import pandas as pd

from replication import published
from replication.files import ROOT
from replication.parallel import in_parallel
from replication.statistics import predictive_region
from studies.replay import inspection, protocols

FRESH_SEEDS = range(36, 39)  # of realisations that the kept ones do not have


def make_cell(row: int, column: str) -> str:
    """What the records give, or one kept realisation and some fresh ones; at the end beside what is committed."""
    cell = f"table2.row{row:02d}.{column}"
    committed = pd.read_csv(ROOT / "results" / "verdicts.csv", index_col="id").at[
        cell, "reproduced"
    ]
    if column == "noise":
        return compare(inspection.noise_amplitudes()[row - 1], committed)
    if column == "theoretical":
        return compare(inspection.interpolated_peak_rps(protocols.clean_record(row)), committed)
    leader = protocols.CANDIDATES[protocols.LEADER]
    calls = [(leader, row, 1, seed) for seed in (protocols.STUDY_SEED, *FRESH_SEEDS)]
    made = pd.DataFrame(in_parallel(protocols.realise, calls, f"row {row}"))[f"{column}_A_rps"]
    table = pd.read_csv(protocols.REALISATIONS).query("protocol == @leader.name and row == @row")
    kept = table[f"{column}_A_rps"]
    low, high = predictive_region(kept)
    return f"""\
settings: {leader.name}; {protocols.RUNS} runs for each realisation
fresh: {", ".join(made[1:].map("{:.6g}".format))} rps, with other noise and other seeds
their interval: {low:.6g} to {high:.6g} rps, from {kept.size} kept ones
printed: {published.value(cell):g} rps
the first kept: {compare(made[0], kept.iloc[0])}"""


def compare(now: float, committed: float) -> str:
    """Two numbers side by side, in the six digits that are kept."""
    same = f"{now:.6g}" == f"{committed:.6g}"
    return (
        f"recomputed {now:.6g}, committed {committed:.6g}: {'identical' if same else 'different'}"
    )


if __name__ == "__main__":
    print(make_cell(int(sys.argv[1]), sys.argv[2]))
