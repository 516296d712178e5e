"""The collection of the results, and what they were made from, as the notebooks' kernels noted it."""

import hashlib
from pathlib import Path

from replication import published
from replication.files import ROOT, write_csv, write_json
from workbook.judging import decided_claims, outcomes, verdicts


def collect(results: Path) -> None:
    """Write `verdicts.csv`, `claims.csv` and `provenance.json` from what the notebooks exported."""
    write_csv(results / "verdicts.csv", verdicts(results))
    claims = published.claims().reset_index()[["id", "claim", "section"]]
    write_csv(results / "claims.csv", claims.merge(decided_claims(results), on="id", how="left"))
    write_json(results / "provenance.json", {name: outcome["made_from"] for name, outcome in outcomes(results).items()})


def stale(results: Path) -> dict[str, list[str]]:
    """Find the notebooks whose results were made from sources that have changed since, and those sources."""
    made_from = {notebook: outcome["made_from"]["sources"] for notebook, outcome in outcomes(results).items()}
    files = {name: ROOT / name for sources in made_from.values() for name in sources}
    now = {name: hashlib.sha256(file.read_bytes()).hexdigest() for name, file in files.items() if file.exists()}
    changed = {
        notebook: [name for name, digest in sources.items() if now.get(name) != digest]
        for notebook, sources in made_from.items()
    }
    return {notebook: names for notebook, names in changed.items() if names}
