"""The collection of the results, and what they were made from, as the notebooks' kernels noted it."""

import hashlib
from functools import cache
from pathlib import Path

from replication import published
from replication.files import ROOT, write_csv, write_json
from workbook.judging import decided_claims, verdicts
from workbook.outcomes import load_outcomes


def collect(results: Path) -> None:
    """Write `verdicts.csv`, `claims.csv` and `provenance.json` from what the notebooks exported."""
    write_csv(results / "verdicts.csv", verdicts(results))
    claims = published.claims().reset_index()[["id", "claim", "section"]]
    write_csv(results / "claims.csv", claims.merge(decided_claims(results), on="id", how="left"))
    made_from = {name: outcome["made_from"] for name, outcome in load_outcomes(results).items()}
    write_json(results / "provenance.json", made_from)


def stale(results: Path) -> dict[str, list[str]]:
    """Find the notebooks whose sources have changed since their results were made, and which."""
    found = {}
    for notebook, outcome in load_outcomes(results).items():
        sources = outcome["made_from"]["sources"]
        if changed := [name for name, digest in sources.items() if _digest_now(name) != digest]:
            found[notebook] = changed
    return found


@cache
def _digest_now(name: str) -> str:
    file = ROOT / name
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else ""
