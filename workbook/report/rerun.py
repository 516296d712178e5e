"""Making one result again: a cell of Table 2 from its row alone, anything else with its notebook."""

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from workbook import judging
from workbook.checkout import RESULTS, ROOT, notebook_files
from workbook.report import Unknown, terminal

# What a row gives without its notebook. Row 1's peak is that of a simulated record: notebook 3 has it.
OF_ROW = re.compile(r"table2\.row(?!01\.t)(\d\d)\.(mean|sd|noise|theoretical)")


def find_notebooks(name: str, results: Path) -> list[str]:
    """Find the notebooks that make a cell, an element or a claim."""
    tables = (pd.read_csv(results / f"{table}.csv") for table in ("verdicts", "claims"))
    made = pd.concat(tables).dropna(subset="notebook")
    ids = made["id"]
    named = (ids.str.lower() == name) | (ids.str.partition(".")[0] == name)
    if not named.any():
        raise Unknown(f"{name}: no notebook makes it")
    return sorted(made.loc[named, "notebook"].unique())


def announce(name: str, notebooks: Sequence[str], results: Path) -> str:
    """Say what makes a result again, and how long it takes."""
    seconds = pd.read_csv(results / "notebook_times.csv").set_index("notebook")["seconds"]
    how = [f"{notebook} ({seconds[notebook]:g} s when measured)" for notebook in notebooks]
    if OF_ROW.fullmatch(name):
        how = ["its row alone, in seconds"]
    return f"{name} is made again by {', '.join(how)}"


def make_again(name: str, notebooks: Sequence[str]) -> str:
    """Describe what was announced as it comes out now; the results stay as they are."""
    from workbook import execution

    if cell := OF_ROW.fullmatch(name):
        # A study makes it, in a process of its own.
        command = [sys.executable, "-m", "studies.replay.cell", *cell.groups()]
        made = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
        found = json.loads(made.stdout)
        beside = [f"{label}: {text}" for label, text in found["beside"].items()]
        label = "the first kept: " if beside else ""
        both = label + _compare(found["recomputed"], found["committed"])
        return terminal.align("\n".join([*beside, both]))
    with tempfile.TemporaryDirectory() as folder:
        for notebook in notebooks:
            execution.execute(notebook_files("py")[notebook], Path(folder))
        results = Path(folder) / "results"
        now, committed = (
            judging.verdicts(place).set_index("id")["reproduced"].rename(str.lower)
            for place in (results, RESULTS)
        )
        said = [terminal.show(name, results)]
        if name in now:
            said.append(_compare(now[name], committed[name]))
        return "\n".join(said)


def _compare(now: float, committed: float) -> str:
    """Two numbers side by side, in the six digits that are kept."""
    recomputed, kept = f"{now:.6g}", f"{committed:.6g}"
    same = "identical" if recomputed == kept else "different"
    return f"recomputed {recomputed}, committed {kept}: {same}"
