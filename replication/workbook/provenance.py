"""What the results were made from, as the notebooks' kernels noted it, and the collection of the results."""

import hashlib
from pathlib import Path

import pandas as pd

from replication import published
from replication.workbook.files import ROOT, write_csv, write_json
from replication.workbook.judging import decided_claims, outcomes, verdicts


def collect(results: Path) -> pd.DataFrame:
    """Write `verdicts.csv`, `claims.csv` and `provenance.json` from what the notebooks exported."""
    table = verdicts(results)
    write_csv(results / "verdicts.csv", table)
    claims = published.claims().reset_index()[["id", "claim", "section"]]
    write_csv(results / "claims.csv", claims.merge(decided_claims(results), on="id", how="left"))
    write_json(results / "provenance.json", {name: outcome["made_from"] for name, outcome in outcomes(results).items()})
    return table


def stale(results: Path) -> dict[str, list[str]]:
    """Find the notebooks whose results were made from sources that have changed since."""
    now: dict[str, str] = {}

    def digest(name: str) -> str:
        if name not in now:
            path = ROOT / name
            now[name] = hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else "gone"
        return now[name]

    changed = {
        notebook: [name for name, before in outcome["made_from"]["sources"].items() if digest(name) != before]
        for notebook, outcome in outcomes(results).items()
    }
    return {notebook: files for notebook, files in changed.items() if files}


def dependencies(stamps: str, notebook: str, sources: list[str]) -> str:
    """Rule for make: a notebook's stamp depends on its sources, each of which may vanish."""
    return f"{stamps}/{notebook}.done: {' '.join(sources)}\n\n{' '.join(sources)}:\n"
