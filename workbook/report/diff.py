"""What changed: cells and claims whose value or verdict is another than in the committed results."""

import io
import subprocess
from pathlib import Path

import pandas as pd

from replication.files import FLOAT_FORMAT, ROOT
from workbook import judging

COLUMNS = ["flips", "id", "source", "value_before", "value_now", "verdict_before", "verdict_now"]


class NotComparable(RuntimeError):
    """There are no results to compare, or no committed ones to compare with."""

    exit_status = 1


def committed_table(name: str, root: Path = ROOT) -> pd.DataFrame:
    """Load a table of the results as the last commit has it."""
    command = ["git", "show", f"HEAD:./results/{name}"]
    try:
        shown = subprocess.run(command, cwd=root, capture_output=True, text=True, encoding="utf-8", check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        why = "no committed copy to compare with; this needs git and a clone of the repository"
        raise NotComparable(f"results/{name}: {why}") from error
    return pd.read_csv(io.StringIO(shown))


def list_changes(results: Path, verdicts: pd.DataFrame, claims: pd.DataFrame) -> pd.DataFrame:
    """List the cells and claims that the notebooks in a results folder decide otherwise than the committed tables.

    A value is a number with six digits, or a claim's measured text; `flips` marks another verdict. What a notebook
    decided before and no longer exports is `not-run` now.
    """
    folder = results.relative_to(ROOT) if results.is_relative_to(ROOT) else results
    try:
        outcomes, cells, decided = judging.outcomes(results), judging.verdicts(results), judging.decided_claims(results)
    except (ValueError, KeyError, TypeError) as error:
        raise NotComparable(f"{folder}: what a notebook exported cannot be read: {error}") from error
    if not outcomes:
        raise NotComparable(f"{folder}: no notebook has been run there")
    before, now = _values(verdicts, claims), _values(cells, decided)
    before = before[before["notebook"].isin(outcomes) | before.index.isin(now.index)]
    both = before.add_suffix("_before").join(now.add_suffix("_now"), how="outer")
    both = both.fillna({"verdict_before": "not-run", "verdict_now": "not-run"}).fillna("").reset_index()
    both["flips"] = both["verdict_before"] != both["verdict_now"]
    changed = both.loc[both["flips"] | (both["value_before"] != both["value_now"]), COLUMNS]
    return changed.sort_values("flips", ascending=False, kind="stable", ignore_index=True)


def _values(verdicts: pd.DataFrame, claims: pd.DataFrame) -> pd.DataFrame:
    """Value (as text; a number with six digits), verdict and notebook of what has been run, by id and source."""
    numbers = verdicts["reproduced"].map(lambda number: FLOAT_FORMAT % number).replace("nan", "")
    table = pd.concat([verdicts.assign(value=numbers), claims.assign(source="claim", value=claims["measured"])])
    return table[table["verdict"] != "not-run"].set_index(["id", "source"])[["value", "verdict", "notebook"]]


def describe_change(row: dict) -> str:
    """One line of text on a row of `list_changes`."""
    verdict = f"{row['verdict_before']} -> {row['verdict_now']}" if row["flips"] else row["verdict_now"]
    value = f"{row['value_before'] or '(none)'} -> {row['value_now'] or '(none)'}"
    value = row["value_now"] if row["value_before"] == row["value_now"] else value
    return f"{'FLIPS' if row['flips'] else 'moved'} {row['id']} ({row['source']}): {verdict}; {value}"
