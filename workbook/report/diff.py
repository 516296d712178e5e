"""What changed: cells and claims whose value or verdict is not that of the committed results."""

import io
import subprocess
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from replication import published
from replication.files import FLOAT_FORMAT, ROOT
from workbook import judging
from workbook.outcomes import load_outcomes


class NotComparable(RuntimeError):
    """There are no results to compare, or no committed ones to compare with."""

    exit_status = 1


class Decision(NamedTuple):
    """What is said of a cell or a claim: a number with six digits or a text."""

    verdict: str = "(none)"
    value: str = "(none)"
    notebook: str = ""
    chance: bool = True  # whether it depends on how often something was repeated


def committed_table(name: str, root: Path = ROOT) -> pd.DataFrame:
    """Load a table of the results as the last commit has it."""
    command = ["git", "show", f"HEAD:./results/{name}"]
    try:
        shown = subprocess.run(command, cwd=root, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        why = "no committed copy to compare with; this needs git and a clone of the repository"
        raise NotComparable(f"results/{name}: {why}") from error
    return pd.read_csv(io.BytesIO(shown.stdout))


def list_changes(
    results: Path, verdicts: pd.DataFrame, claims: pd.DataFrame, repeats: bool = True
) -> list[str]:
    """List what the notebooks in a results folder decide otherwise than the committed tables.

    The lines of other verdicts, FLIPS, come first. What a notebook decided before and no longer
    exports is "(none)" now. Where repeats differ, `moved` is only what does not depend on them:
    cells that are not stochastic.
    """
    try:
        run = load_outcomes(results)
        now = _decisions(judging.verdicts(results), judging.decided_claims(results))
    except (ValueError, KeyError, TypeError) as error:
        raise NotComparable(
            f"{results}: what a notebook exported cannot be read: {error}"
        ) from error
    if not run:
        raise NotComparable(f"{results}: no notebook has been run there")
    before = _decisions(verdicts, claims)
    lines = []
    for name in dict.fromkeys([*before, *now]):
        old, new = before.get(name, Decision()), now.get(name, Decision())
        notebook = new.notebook if new.notebook in run else old.notebook
        stays = old.verdict == new.verdict
        if old[:2] == new[:2] or notebook not in run or (stays and new.chance and not repeats):
            continue
        verdict, value = (
            a if a == b else f"{a} -> {b}" for a, b in zip(old[:2], new[:2], strict=True)
        )
        lines.append(f"{'moved' if stays else 'FLIPS'} {name}, {notebook}: {verdict}; {value}")
    return sorted(lines, key=lambda line: line[:5])


def _decisions(verdicts: pd.DataFrame, claims: pd.DataFrame) -> dict[str, Decision]:
    """What has been decided, by the id of a cell or a claim."""
    found = {}
    chance = published.cells()["kind"] == "stochastic"
    for row in verdicts.dropna(subset="reproduced").itertuples():
        value = FLOAT_FORMAT % row.reproduced
        found[row.id] = Decision(row.agreement, value, row.notebook, chance[row.id])
    for row in claims.dropna(subset="verdict").itertuples():
        found[f"{row.id} (claim)"] = Decision(row.verdict, row.measured, row.notebook)
    return found
