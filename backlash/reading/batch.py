"""Tables that list logs: every cell is text, converted for its own row alone."""

import io
import re
from collections.abc import Mapping
from os import PathLike
from typing import Any, TypeAlias

import pandas as pd

from backlash.reading.sources import MOST_TABLE_BYTES, naming, read_bytes, unpacked
from backlash.reading.tables import decoded
from backlash.refusals import Refusal

TableOfLogs: TypeAlias = pd.DataFrame | str | PathLike[str]
KEYS = ["joint", "date"]
_TEXTS = {"file", "log", "joint", "time", "speed", "position", "torque", "unit", "time_unit"}
_TEXTS |= {"calibration", "method"}
_TRUTHS = dict.fromkeys(("yes", "true", "y", "1"), True)
_TRUTHS |= dict.fromkeys(("no", "false", "n", "0"), False)


def read_rows(source: TableOfLogs, *columns: str) -> pd.DataFrame:
    """Rows of a table of logs, which has some columns: of a CSV file texts, and empty cells as missing."""
    table = source if isinstance(source, pd.DataFrame) else _read_file(str(source))
    table = table.reset_index(drop=table.index.names == [None])
    if missing := [name for name in columns if name not in table]:
        there = ", ".join(map(repr, table.columns))[:300]
        raise Refusal(f"{called(source)}: no column {missing[0]!r}; there are {there}")
    if table.empty:
        raise Refusal(f"{called(source)}: no rows")
    if "date" in columns:
        try:
            table["date"] = _as_dates(table["date"])
        except ValueError as error:
            raise Refusal(f"{called(source)}: no dates ({error})") from error
    return table


def keys_of(table: pd.DataFrame) -> pd.DataFrame:
    """Joints, escaped as names of files are, and dates of a table's rows, as far as it has them."""
    keys = table[[name for name in KEYS if name in table]].copy()
    if "joint" in keys:
        keys["joint"] = keys["joint"].map(escape, na_action="ignore")
    if "date" in keys:
        keys["date"] = _as_dates(keys["date"], errors="coerce")
    return keys


def _as_dates(cells: pd.Series, errors: Any = "raise") -> pd.Series:
    return pd.to_datetime(cells, format="ISO8601", utc=True, errors=errors).dt.tz_localize(None)


def escape(name: object) -> str:
    """A name that a table can hold, and that is no formula for a spreadsheet."""
    return re.sub(r"^(?=[=+@\s-])", "'", str(name).encode(errors="replace").decode())


def _read_file(name: str) -> pd.DataFrame:
    with naming(name):
        content = unpacked(read_bytes(name, MOST_TABLE_BYTES))
        if content.startswith(b"PAR1"):
            return pd.read_parquet(io.BytesIO(content))
        text = decoded(content)
        first = text.partition("\n")[0]
        return pd.read_csv(
            io.StringIO(text),
            sep=";" if ";" in first and "," not in first else ",",
            dtype=str,
            keep_default_na=False,
            na_values=[""],
            index_col=False,
        )


def options_of(row: Mapping[Any, Any]) -> dict[str, Any]:
    """What a row says of its log, as `estimate` takes it; an empty cell says nothing.

    Raises
    ------
    Refusal
        A cell is not what its column holds.
    """
    return {str(name): _value(str(name), cell) for name, cell in row.items() if not pd.isna(cell)}


def _value(name: str, cell: Any) -> Any:
    """A cell as text, date, number, or yes and no, by its column's name."""
    if name in _TEXTS:
        return str(cell).strip()
    wanted = "no number"
    try:
        if name == "date":
            wanted = "no date like 2024-03-17"
            return pd.Timestamp(cell).tz_localize(None)
        if name == "trust_period":
            wanted = "neither yes nor no"
            return _TRUTHS[str(cell).strip().lower()]
        return float(cell)
    except (ValueError, TypeError, KeyError) as error:
        raise Refusal(f"{name} is {str(cell)[:40]!r}, {wanted}") from error


def called(source: TableOfLogs) -> str:
    """What a table is called in a refusal."""
    return "the table" if isinstance(source, pd.DataFrame) else str(source)
