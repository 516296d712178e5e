"""A cell of Table 2 from its row alone: `python -m studies.replay.cell ROW COLUMN`."""

import sys

import pandas as pd

from replication import published
from replication.parallel import in_parallel
from replication.statistics import predictive_region
from studies.replay import inspection, protocols

FRESH_SEEDS = range(36, 39)  # of realisations that the kept ones do not have


def make_cell(row: int, column: str) -> str:
    """What the records give, or one kept and some fresh realisations beside the region of those kept."""
    if column == "noise":
        return f"made again: {inspection.noise_amplitudes()[row - 1]:.6g} rps"
    if column == "theoretical":
        record = protocols.clean_record(row)
        return f"made again: {inspection.interpolated_peak_rps(record):.6g} rps"
    leader = protocols.CANDIDATES[protocols.LEADER]
    calls = [(leader, row, 1, seed) for seed in (protocols.STUDY_SEED, *FRESH_SEEDS)]
    made = pd.DataFrame(in_parallel(protocols.realise, calls, f"row {row}"))[f"{column}_A_rps"]
    table = pd.read_csv(protocols.REALISATIONS).query("protocol == @leader.name and row == @row")
    kept = table[f"{column}_A_rps"]
    low, high = predictive_region(kept)
    return f"""\
candidate: {leader.name}, the leading one; {protocols.RUNS} runs each
the first kept: {kept.iloc[0]:.6g} rps; made again: {made[0]:.6g} rps
fresh: {", ".join(made[1:].map("{:.6g}".format))} rps, with other noise and other seeds
their region: {low:.6g} to {high:.6g} rps, from {kept.size} kept ones
printed: {published.value(f"table2.row{row:02d}.{column}"):g} rps"""


if __name__ == "__main__":
    print(make_cell(int(sys.argv[1]), sys.argv[2]))
