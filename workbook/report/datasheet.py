"""The sensor's datasheet as a page shows it."""

from pathlib import Path

import pandas as pd

FEW_LOGS = 10  # fewer have counts in place of shares


def read_rows(results: Path, name: str) -> list[dict]:
    """The rows of a table of the results; none if it is not there."""
    file = results / f"{name}.csv"
    return pd.read_csv(file).to_dict("records") if file.exists() else []


def datasheet_rows(results: Path) -> list[dict]:
    """The rows of `datasheet.csv` as texts."""
    return [
        {
            "population": row["population"],
            "logs": row["logs"],
            "answered": _share(row, "answered", row["asked"]),
            "covered": _share(row, "covered", row["answers"]),
            "rmse": "" if pd.isna(row["rmse_rad"]) else f"{1e3 * row['rmse_rad']:.3f}",
            "false_alarms": _count(row["false_alarms"], row["healthy"]),
            "false_all_clears": _count(row["false_all_clears"], row["ill"]),
        }
        for row in read_rows(results, "datasheet")
    ]


def _count(hits: int, logs: int) -> str:
    """A count among logs, blank without logs."""
    return f"{hits} of {logs}" if logs else ""


def _share(row: dict, name: str, logs: float) -> str:
    """A share with its 95 % limits in percent, of few logs the count."""
    if pd.isna(row[f"{name}_low"]):
        return ""
    if logs < FEW_LOGS - 0.5:
        return f"{logs * row[name]:.0f} of {logs:.0f}"
    share, low, high = (100 * row[key] for key in (name, f"{name}_low", f"{name}_high"))
    return f"{share:.0f} % ({low:.0f} to {high:.0f})"
