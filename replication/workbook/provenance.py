"""What the results were made from, and their collection."""

import hashlib
import json
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

import pandas as pd

from replication import published
from replication.workbook.files import ROOT, write_csv, write_json
from replication.workbook.judging import decided_claims, outcomes, verdicts

# What the results are made from; the outputs beside them are not.
SOURCES = (
    "replication/**/*.py",
    "replication/data/*",
    "replication/workbook/templates/*",
    "notebooks/*.py",
    "requirements.lock",
)

PACKAGES = ("cma", "joblib", "jupytext", "matplotlib", "nbclient", "numba", "numpy", "pandas", "scipy")


def collect(results: Path) -> pd.DataFrame:
    """Write `verdicts.csv`, `claims.csv` and `provenance.json` from the notebooks' outcomes.

    Returns
    -------
    DataFrame
        The verdicts.
    """
    table = verdicts(results)
    write_csv(results / "verdicts.csv", table)
    claims = published.claims().reset_index()[["id", "claim", "section"]]
    write_csv(results / "claims.csv", claims.merge(decided_claims(results), on="id", how="left"))
    path = results / "provenance.json"
    before = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    write_json(path, _provenance(outcomes(results), before.get("sources", {})))
    return table


def _provenance(outcomes: dict[str, dict], sources_before: dict) -> dict:
    return {
        "sources": _sources(sources_before),
        "python": platform.python_version(),
        "packages": {name: version(name) for name in PACKAGES},
        "notebooks": {
            name: {"seeds": outcome["seeds"], "inputs": outcome["inputs"]} for name, outcome in outcomes.items()
        },
    }


def _sources(before: dict) -> dict:
    """Fingerprint of the sources, and the commit that they were first collected at.

    A page cannot name the commit that it is part of. So the commit is noted when the sources change, and kept while
    their fingerprint is the same: a second run, and a run after committing, give the same bytes.
    """
    files = sorted(path for pattern in SOURCES for path in ROOT.glob(pattern) if path.is_file())
    digests = (hashlib.sha256(path.read_bytes()).hexdigest() for path in files)
    lines = [f"{digest}  {path.relative_to(ROOT).as_posix()}\n" for digest, path in zip(digests, files, strict=True)]
    fingerprint = hashlib.sha256("".join(lines).encode()).hexdigest()
    if before.get("sha256") == fingerprint:
        return before
    commit, _, committed = _git("log", "-1", "--format=%H %cs").partition(" ")
    changed = bool(_git("status", "--porcelain", "--", *SOURCES)) if commit else False
    return {"sha256": fingerprint, "commit": commit, "committed": committed, "local_changes": changed}


def _git(*arguments: str) -> str:
    """What git says, or nothing where there is no git or no repository."""
    try:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip()
