"""A cell of Table 2 from its row: `python -m studies.replay.cell ROW COLUMN` prints JSON."""

import json
import sys

import pandas as pd

from replication import published
from replication.files import ROOT
from replication.parallel import in_parallel
from replication.table2 import prediction_interval
from studies.replay import inspection, protocols

FRESH_SEEDS = range(36, 39)  # of realisations that the kept ones do not have


def make_cell(row: int, column: str) -> dict[str, float | dict[str, str]]:
    """What the records give, or one kept realisation, beside what is committed; some fresh realisations in words."""
    cell = f"table2.row{row:02d}.{column}"
    if column in ("noise", "theoretical"):
        verdicts = pd.read_csv(ROOT / "results" / "verdicts.csv", index_col="id")
        made = (
            inspection.noise_amplitudes()[row - 1]
            if column == "noise"
            else inspection.interpolated_peak_rps(protocols.clean_record(row))
        )
        return {"recomputed": made, "committed": verdicts.at[cell, "reproduced"], "beside": {}}
    leader = protocols.CANDIDATES[protocols.LEADER]
    calls = [(leader, row, 1, seed) for seed in (protocols.STUDY_SEED, *FRESH_SEEDS)]
    made = pd.DataFrame(in_parallel(protocols.realise, calls, f"row {row}"))[f"{column}_A_rps"]
    table = pd.read_csv(protocols.REALISATIONS).query("protocol == @leader.name and row == @row")
    kept = table[f"{column}_A_rps"]
    low, high = prediction_interval(kept)
    fresh = ", ".join(made[1:].map("{:.6g}".format))
    beside = {
        "settings": f"{leader.name}; {protocols.RUNS} runs for each realisation",
        "fresh": f"{fresh} rps, with other noise and other seeds",
        "their interval": f"{low:.6g} to {high:.6g} rps, from {kept.size} kept ones",
        "printed": f"{published.value(cell):g} rps",
    }
    return {"recomputed": made[0], "committed": kept.iloc[0], "beside": beside}


if __name__ == "__main__":
    print(json.dumps(make_cell(int(sys.argv[1]), sys.argv[2])))
