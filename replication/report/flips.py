"""What changed: cells and claims whose verdict is another than in the committed results."""

import io
import subprocess
from pathlib import Path

import pandas as pd

from replication import workbook
from replication.workbook import judging


class NoCommit(RuntimeError):
    """There are no committed results to compare with."""


def committed(name: str, root: Path = workbook.ROOT) -> pd.DataFrame:
    """Load a table of the results as the last commit has it.

    Parameters
    ----------
    name : str
        File name in `results`.
    root : Path
        The project's folder.

    Raises
    ------
    NoCommit
        There is no git, no repository, or no such file in the last commit.
    """
    command = ["git", "show", f"HEAD:./results/{name}"]
    try:
        shown = subprocess.run(command, cwd=root, capture_output=True, text=True, encoding="utf-8", check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        raise NoCommit(
            f"results/{name}: no committed copy to compare with; this needs git and a clone of the repository"
        ) from error
    return pd.read_csv(io.StringIO(shown))


def flips(results: Path, verdicts: pd.DataFrame, claims: pd.DataFrame) -> pd.DataFrame:
    """Compare what is in a results folder with a table of verdicts and one of claims.

    Parameters
    ----------
    results : Path
        Folder with the notebooks' outcomes.
    verdicts, claims : DataFrame
        What to compare with: `verdicts.csv` and `claims.csv`.

    Returns
    -------
    DataFrame
        `id, source, before, after, value_before, value_after` of each cell and claim that the outcomes decide and whose
        verdict differs.
    """
    now = judging.verdicts(results)
    cells = _flipped(
        verdicts.set_index(["id", "source"])[["verdict", "reproduced"]],
        now[now["verdict"] != "not-run"].set_index(["id", "source"])[["verdict", "reproduced"]],
    )
    before, after = (
        table.assign(source="claim").set_index(["id", "source"])[["verdict", "measured"]]
        for table in (claims, judging.decided_claims(results))
    )
    return pd.concat([cells, _flipped(before, after)], ignore_index=True)


def _flipped(before: pd.DataFrame, after: pd.DataFrame) -> pd.DataFrame:
    """Rows of two tables of verdict and value, by id and source, whose verdicts differ."""
    before.columns, after.columns = ["before", "value_before"], ["after", "value_after"]
    both = after.join(before, how="left").fillna({"before": "not-run"}).reset_index()
    names = ["id", "source", "before", "after", "value_before", "value_after"]
    return both.loc[both["before"] != both["after"], names].astype(object)
