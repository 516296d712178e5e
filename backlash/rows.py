"""Tables that list logs: what is said of each, or answers on them."""

import io
from os import PathLike
from typing import TypeAlias

import pandas as pd

from backlash.reading.sources import MOST_TABLE_BYTES, naming, read_bytes, unpacked
from backlash.reading.tables import MOST_COLUMNS
from backlash.refusals import Refusal

Table: TypeAlias = pd.DataFrame | str | PathLike[str]
_TEXTS = ("file", "log", "joint", "time", "speed", "position", "torque", "calibration")
_LONGEST_HEADER = 2**16  # bytes


def read_rows(source: Table, *columns: str) -> pd.DataFrame:
    """Rows of a table with some columns; dates as such, other columns of names as text."""
    try:
        table = source if isinstance(source, pd.DataFrame) else _read_csv(str(source))
        table = table.reset_index(drop=table.index.names == [None])
        if "date" in table:
            dates = pd.to_datetime(table["date"], format="ISO8601", utc=True)
            table["date"] = dates.dt.tz_localize(None)
        if table[[*columns]].empty:
            raise ValueError("no rows")
        return table
    except (ValueError, KeyError) as error:
        if isinstance(error, Refusal):
            raise
        wanted = " and ".join(columns)
        raise Refusal(f"{called(source)}: no table with the columns {wanted} ({error})") from error


def _read_csv(name: str) -> pd.DataFrame:
    """Read a table of logs; its columns are those of its first line."""
    with naming(name):
        content = unpacked(read_bytes(name, MOST_TABLE_BYTES))
    if content[:_LONGEST_HEADER].split(b"\n")[0].count(b",") >= MOST_COLUMNS:
        raise Refusal(f"{name}: more than {MOST_COLUMNS} columns; that is no table of logs")
    return pd.read_csv(io.BytesIO(content), dtype=dict.fromkeys(_TEXTS, str), index_col=False)


def called(source: Table) -> str:
    """What a table is called in a refusal."""
    return "the table" if isinstance(source, pd.DataFrame) else str(source)
