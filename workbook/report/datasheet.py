"""The sensor's datasheet as a page shows it."""

from pathlib import Path

import pandas as pd

FEW_LOGS = 10  # fewer have counts in place of shares


def datasheet_rows(results: Path) -> list[dict]:
    """The rows of `datasheet.csv` as texts; none if it is not there."""
    file = results / "datasheet.csv"
    if not file.exists():
        return []
    table = pd.read_csv(file)
    return [
        {
            "population": row["population"],
            "logs": row["logs"],
            "answered": _share(row, "answered", row["logs"]),
            "covered": _share(row, "covered", row["logs"] * row["answered"]),
            "rmse": "" if pd.isna(row["rmse_rad"]) else f"{1e3 * row['rmse_rad']:.3f}",
            "wrong_healthy": row["wrong_healthy"],
        }
        for row in table.to_dict("records")
    ]


def _share(row: dict, name: str, logs: float) -> str:
    """A share with its 95 % limits in percent, of few logs the count."""
    if pd.isna(row[f"{name}_low"]):
        return ""
    if logs < FEW_LOGS - 0.5:
        return f"{logs * row[name]:.0f} of {logs:.0f}"
    share, low, high = (100 * row[key] for key in (name, f"{name}_low", f"{name}_high"))
    return f"{share:.0f} % ({low:.0f} to {high:.0f})"
