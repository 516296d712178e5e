"""Making one result again: a cell of Table 2 from its row alone, anything else with its notebook."""

import csv
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from workbook.checkout import RESULTS, ROOT, notebook_files
from workbook.report import Unknown

# What a row gives without its notebook. Row 1's peak is that of a simulated record: notebook 3 has it.
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
        made = _make_cell(cell[1], cell[2])
        beside = [f"{label}: {text}" for label, text in made["beside"].items()]
        label = "the first kept: " if beside else ""
        both = label + _both(made["recomputed"], made["committed"])
        return terminal.align("\n".join([*beside, both]))
    with tempfile.TemporaryDirectory() as folder:
        for notebook in notebooks:
            execution.execute(notebook_files("py")[notebook], Path(folder))
        results = Path(folder) / "results"
        return "\n".join([terminal.show(name, results), *_compare(name, results)])


def _compare(name: str, results: Path) -> list[str]:
    """Our number of a cell made again, beside the committed one; nothing of what is no cell."""
    from workbook import judging

    now, committed = (
        {row["id"].lower(): row["reproduced"] for row in judging.verdicts(place).to_dict("records")}
        for place in (results, RESULTS)
    )
    if name not in now:
        return []
    return [_both(now[name], committed[name])]


def _both(now: float, committed: float) -> str:
    """Two numbers side by side, in the six digits that are kept."""
    recomputed, kept = f"{now:.6g}", f"{committed:.6g}"
    same = "identical" if recomputed == kept else "different"
    return f"recomputed {recomputed}, committed {kept}: {same}"


def _make_cell(row: str, column: str) -> dict[str, Any]:
    """What a study finds for a cell, in a process of its own."""
    command = [sys.executable, "-m", "studies.replay.cell", row, column]
    made = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(made.stdout)
