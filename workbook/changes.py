"""What a change did: parameters, numbers and decisions that are not those of the committed run."""

import io
import os
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from replication import published
from replication.files import FLOAT_FORMAT, ROOT
from workbook import outcomes
from workbook.checkout import RESULTS, notebook_files
from workbook.parameters import GIVEN


class NotComparable(RuntimeError):
    """There are no results to compare, or no committed ones to compare with."""

    exit_status = 1


class Decision(NamedTuple):
    """What is said of a cell or a claim: a number with six digits or a text."""

    verdict: str = "(none)"
    value: str = "(none)"
    notebook: str = ""
    chance: bool = True  # whether it depends on how often something was repeated


def judge(
    cells: outcomes.Cells | None = None, claims: outcomes.Claims | None = None
) -> pd.DataFrame:
    """Judge our numbers by cell id, and decisions on claims with what was measured.

    Several numbers are realisations by setting. A claim whose truth value is None is undecided.
    """
    # With the search, which not every notebook is made from.
    from workbook import judging

    found = pd.DataFrame(outcomes.cell_rows(cells or {})).assign(notebook="")
    judged = judging.judge_rows(found).rename(columns={"agreement": "verdict"}).to_dict("records")
    for claim, (holds, measured) in (claims or {}).items():
        judged.append(
            {"id": claim, "reproduced": measured, "verdict": judging.CLAIM_VERDICTS[holds]}
        )
    shown = ["id", "printed", "reproduced", "low", "high", "verdict", "source", "reason"]
    return pd.DataFrame(judged, columns=shown).astype(object).fillna("")


def verdict(
    text: str, cells: outcomes.Cells | None = None, claims: outcomes.Claims | None = None
) -> None:
    """Show how numbers and decisions are judged, and a sentence on it, which begins with the changed parameters."""
    from IPython.display import display

    if cells or claims:
        display(judge(cells, claims))
    changed = " and ".join(changed_parameters())
    display(outcomes.Sentence(f"**With {changed}:** {text}" if changed else text))


def changed_parameters() -> list[str]:
    """Parameters of the notebook that runs that are not those of its source, with both values."""
    source = notebook_files("py").get(outcomes.notebook_name())
    if source is None:
        return []
    committed: dict[str, Any] = {}
    text = source.read_text(encoding="utf-8").partition('tags=["parameters"]\n')[2]
    exec(text.partition("\n# %%")[0], committed)
    return [
        f"`{name} = {getattr(value, '__name__', repr(value))}` ({committed[name]!r} in the committed run)"
        for name, value in GIVEN.items()
        if name in committed and repr(value) != repr(committed[name])
    ]


def export(**parts: Any) -> None:
    """Write what a notebook found, as `outcomes.export` does; by hand show what the committed run decided otherwise."""
    outcome = outcomes.export(**parts)
    if "REPLICATION_OUT" not in os.environ:
        _show_changes(outcomes.notebook_name(), outcome)


def _show_changes(name: str, outcome: Mapping[str, Any]) -> None:
    from IPython.display import display

    kept = (pd.read_csv(RESULTS / f"{table}.csv") for table in ("verdicts", "claims"))
    lines = sort_changes(_changes(name, outcome, _decisions(*kept), repeats=True))
    listed = "".join(f"\n- {line}" for line in lines)
    changed = f"against the committed run:\n{listed}" if lines else "nothing"
    display(outcomes.Sentence(f"**What changed:** {changed}"))


def committed_table(name: str) -> pd.DataFrame:
    """Load a table of the results as the last commit has it."""
    command = ["git", "show", f"HEAD:./results/{name}"]
    try:
        shown = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        why = "no committed copy to compare with; this needs git and a clone of the repository"
        raise NotComparable(f"results/{name}: {why}") from error
    return pd.read_csv(io.BytesIO(shown.stdout))


def list_changes(
    results: Path, verdicts: pd.DataFrame, claims: pd.DataFrame, repeats: bool = True
) -> list[str]:
    """List what the runs in a results folder decide otherwise than the committed tables.

    The lines of other verdicts, FLIPS, come first. What a notebook decided before and no longer
    exports is "(none)" now. Where repeats differ, `moved` is only what does not depend on them:
    cells that are not stochastic. A run whose notebook is not known has a line of its own.
    """
    before, lines = _decisions(verdicts, claims), []
    known = notebook_files("py")
    try:
        for name, outcome in outcomes.read_outcomes(results).items():
            lines += _changes(name, outcome, before, repeats)
            if name not in known:
                lines.append(f"{name}: run under a name that is no notebook's; compared by its ids")
    except (ValueError, KeyError, TypeError) as error:
        raise NotComparable(
            f"{results}: what a notebook exported cannot be read: {error}"
        ) from error
    if not any(results.glob("outcomes/*.json")):
        raise NotComparable(f"{results}: no notebook has been run there")
    return sort_changes(lines)


def sort_changes(lines: list[str]) -> list[str]:
    """Other verdicts first."""
    return sorted(lines, key=lambda line: not line.startswith("FLIPS"))


def _changes(
    name: str, outcome: Mapping[str, Any], committed: Mapping[str, Decision], repeats: bool
) -> list[str]:
    """What one run decides otherwise than what is committed of its notebook, or of the same ids."""
    from workbook import judging

    made = {name: outcome}
    found = judging.judge_rows(judging.exported_cells(made))
    now = _decisions(found, judging.decide_claims(made))
    before = {key: old for key, old in committed.items() if key in now or old.notebook == name}
    lines = []
    for key in dict.fromkeys([*before, *now]):
        old, new = before.get(key, Decision()), now.get(key, Decision())
        stays = old.verdict == new.verdict
        if old[:2] == new[:2] or (stays and new.chance and not repeats):
            continue
        both = zip(old[:2], new[:2], strict=True)
        said, value = (was if was == becomes else f"{was} -> {becomes}" for was, becomes in both)
        lines.append(f"{'moved' if stays else 'FLIPS'} {key}, {name}: {said}; {value}")
    return lines


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
