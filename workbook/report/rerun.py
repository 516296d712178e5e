"""Making one result again: a cell of Table 2 from its row alone, anything else with its notebook."""

import csv
import re
import tempfile
from pathlib import Path

from workbook.checkout import notebook_files
from workbook.report import Unknown

FRESH_SEEDS = range(36, 39)  # of realisations that the kept ones do not have
# What a row gives without its notebook. Row 1's peak is that of a simulated record: notebook 4 has it.
OF_ROW = re.compile(r"table2\.row(?!01\.t)(\d\d)\.(mean|sd|noise|theoretical)")


def announce(name: str, results: Path) -> set[str]:
    """Say which notebooks make a cell, an element or a claim, at once: without pandas; return their names."""
    times, verdicts, claims = (
        list(csv.DictReader((results / f"{table}.csv").read_text("utf-8").splitlines()))
        for table in ("notebook_times", "verdicts", "claims")
    )
    found = {
        row["notebook"]
        for row in verdicts + claims
        if name in (row["id"].lower(), row["id"].partition(".")[0])
    } - {""}
    if not found:
        raise Unknown(f"{name}: no notebook makes it")
    how = [
        f"{row['notebook']} ({row['seconds']} s when measured)"
        for row in times
        if row["notebook"] in found
    ]
    if OF_ROW.fullmatch(name):
        how = ["its row alone, in seconds"]
    print(f"{name} is made again by {', '.join(how)}", flush=True)
    return found


def make_again(name: str, notebooks: set[str]) -> str:
    """Describe what was announced as it comes out now; the results stay as they are."""
    from workbook import execution
    from workbook.report import terminal

    if cell := OF_ROW.fullmatch(name):
        return terminal.align(_make_cell(name, int(cell[1]), cell[2]))
    with tempfile.TemporaryDirectory() as folder:
        for notebook in notebooks:
            execution.execute(notebook_files("py")[notebook], Path(folder))
        return terminal.show(name, Path(folder) / "results")


def _make_cell(name: str, row: int, column: str) -> str:
    """What the records give, or one kept and some fresh realisations beside the region of those kept."""
    import pandas as pd

    from replication import published
    from replication.parallel import in_parallel
    from replication.replay import inspection, protocols
    from replication.statistics import predictive_region

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
printed: {published.value(name):g} rps"""
