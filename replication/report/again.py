"""Make one result again: a row of Table 2 by itself, anything else by its notebook, apart from the results."""

import re
import tempfile
from pathlib import Path

import pandas as pd

from replication import published, table2, workbook
from replication.report import cells
from replication.report.terminal import Unknown
from replication.simulator.simulate import identified_joint
from replication.workbook import judging

TABLE_2_RUNS = re.compile(r"table2\.row(\d+)\.(mean|sd|relative_error)$")
RUNS = int(published.value("text.runs"))
NOISE_SEED = 1  # of notebook 8's own records


def again(name: str, verdicts: pd.DataFrame) -> tuple[str, pd.DataFrame]:
    """Make what decides a cell, an element or a claim again."""
    if found := TABLE_2_RUNS.match(name):
        own = verdicts[verdicts["id"] == name]
        now = _table2_row(int(found[1]), own)
        made = set(now["source"])
        what = f"{RUNS} runs of the search, seeds 1 to {RUNS}, on row {found[1]}'s record of: {', '.join(sorted(made))}"
        kept = sorted(set(own["source"]) - made)
        if kept:
            what += f"; not made again, because it reads a pool of runs (make protocols): {', '.join(kept)}"
        return what, _beside(verdicts, now[now["id"] == name])
    wanted = _cells_of(name, verdicts)
    if wanted.empty:
        return _claim_again(name)
    notebooks = sorted(set(wanted["notebook"].dropna()) - {""})
    if not notebooks:
        raise Unknown(f"{name}: no notebook makes it")
    now = pd.concat([_outcome(notebook)[0] for notebook in notebooks], ignore_index=True)
    what = f"executed, apart from the results: {', '.join(notebooks)}"
    return what, _beside(verdicts, now[now["id"].isin(wanted["id"])])


def _cells_of(name: str, verdicts: pd.DataFrame) -> pd.DataFrame:
    """Verdicts of a cell or of an element's cells."""
    element = published.cells()["element"].reindex(verdicts["id"]).str.lower().str.replace(" ", "").to_numpy()
    return verdicts[(verdicts["id"] == name) | (element == name.lower().replace(" ", ""))]


def _table2_row(row: int, judged: pd.DataFrame) -> pd.DataFrame:
    """Run the search on one row of Table 2, as notebook 8 does: the authors' record, and ours."""
    seeds = range(1, RUNS + 1)
    noise = published.column("Table 2", "noise")
    records = {}
    if "authors" in set(judged["source"]):
        records["authors"] = [table2.authors_table2_records([1])[row - 1]]
    if "simulated" in set(judged["source"]):
        ours = [*table2.simulated_table2_records(identified_joint(), NOISE_SEED), table2.noise_only_record(NOISE_SEED)]
        records["simulated"] = [ours[row - 1]]
    parts = []
    for source, chosen in records.items():
        runs = table2.repeated_fits(chosen, [table2.AUTHORS], seeds, label=f"row {row}, {source}")
        found = table2.table2_cells(table2.table2(runs, source, noise))
        parts.append(pd.DataFrame({"id": found.index, "source": source, "reproduced": found.to_numpy()}))
    return pd.concat(parts, ignore_index=True)


def _outcome(notebook: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Execute a notebook into a folder of its own; what it says of cells and of claims."""
    from replication.workbook import execution  # takes a second and a half

    with tempfile.TemporaryDirectory() as folder:
        execution.execute(workbook.ROOT / "notebooks" / f"{notebook}.py", destination=Path(folder))
        outcome = judging.outcomes(Path(folder) / "results")[notebook]
    return (
        pd.DataFrame(outcome["cells"], columns=["id", "source", "reproduced", "low", "high"]),
        pd.DataFrame(outcome["claims"], columns=["id", "holds", "measured"]),
    )


def _claim_again(name: str) -> tuple[str, pd.DataFrame]:
    decided = judging.decided_claims(workbook.ROOT / "results").set_index("id")
    if name not in decided.index:
        raise Unknown(f"{name}: no notebook makes it")
    before = decided.loc[name]
    now = _outcome(before["notebook"])[1].set_index("id").loc[name]
    row = {"id": name, "before": before["measured"], "now": now["measured"], "holds": now["holds"]}
    return f"executed, apart from the results: {before['notebook']}", pd.DataFrame([row])


def _beside(verdicts: pd.DataFrame, now: pd.DataFrame) -> pd.DataFrame:
    """Our numbers as they were and as they are now, judged by the same regions."""
    known = {(row["id"], row["source"]): row for row in verdicts.to_dict("records")}
    rows = now.assign(notebook="again").to_dict("records")
    for row in rows:
        before = known[row["id"], row["source"]]
        if cells.predicted(before) and pd.isna(row.get("low")):
            row |= {"low": before["low"], "high": before["high"]}
    judged = judging.judge(pd.DataFrame(rows))
    judged["before"] = [known[row["id"], row["source"]]["reproduced"] for row in rows]
    return judged.rename(columns={"reproduced": "now"})[["id", "source", "printed", "before", "now", "verdict"]]
