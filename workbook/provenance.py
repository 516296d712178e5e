"""The collection of the results, and what they were made from, as the notebooks' kernels noted it."""

from pathlib import Path

from replication import published
from replication.files import write_csv, write_json
from workbook.judging import decided_claims, verdicts
from workbook.outcomes import load_outcomes


def collect(results: Path) -> None:
    """Write `verdicts.csv`, `claims.csv` and `provenance.json` from what the notebooks exported."""
    write_csv(results / "verdicts.csv", verdicts(results))
    claims = published.table("claims").reset_index()[["id", "claim", "section"]]
    write_csv(results / "claims.csv", claims.merge(decided_claims(results), on="id", how="left"))
    made_from = {name: outcome["made_from"] for name, outcome in load_outcomes(results).items()}
    write_json(results / "provenance.json", made_from)
