"""Lists of logs: in folders, or in tables whose cells are text, each converted for its own row alone."""

import csv
import io
import os
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import pandas as pd

from backlash.estimates import GIVEN, check_names, request_for
from backlash.reading import limits
from backlash.reading.columns import listed
from backlash.reading.packed import check_size, is_parquet, read_parquet
from backlash.reading.sources import naming, read_bytes
from backlash.reading.tables import text_of
from backlash.refusals import Refusal

TableOfLogs: TypeAlias = pd.DataFrame | str | PathLike[str]
KEYS = ["joint", "date"]
BEYOND = "beyond the header"  # cells of a row
SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".log", ".gz", ".parquet", ".xlsx")
_TEXTS = {"time", "speed", "position", "torque", "unit", "time_unit"}
_TRUTHS = dict.fromkeys(("yes", "true", "y", "1"), True)
_TRUTHS |= dict.fromkeys(("no", "false", "n", "0"), False)


class Batch(NamedTuple):
    """Logs, what a table's row says of each, and what is given of all; `keys` are joints and dates, if it has them."""

    logs: Sequence[Any]
    rows: Sequence[Mapping[Any, Any]]
    keys: pd.DataFrame
    given: Mapping[str, Any]


def read_batch(source: Sequence[object] | TableOfLogs, given: Mapping[str, Any]) -> Batch:
    """Logs, with what is given of each by its row if they are in a table, else by keywords of `estimate`."""
    if isinstance(source, Sequence) and not isinstance(source, str):
        request_for(given)
        return Batch(source, [{}] * len(source), pd.DataFrame(index=range(len(source))), given)
    if not isinstance(source, pd.DataFrame | str | PathLike):
        raise Refusal(
            f"one {type(source).__name__} of logs; give a list of them, or a pandas table with the column file"
        )
    check_names(given)
    is_frame = isinstance(source, pd.DataFrame)
    with naming("the table" if is_frame else str(source)):
        table = read_rows(source)
        _refuse_misspelt(table)
    logs = table["file"].tolist()
    if not is_frame:  # relative to the table
        logs = [Path(source).parent / _text(cell).replace("\0", "?") for cell in logs]
    keys = keys_of(table)
    # Not only the user may have named a log in a file: a refusal does not quote it.
    is_dated = keys.get("date", table["file"]).notna()
    rows = table.assign(is_dated=is_dated, is_quoted=is_frame).to_dict("records")
    return Batch(logs, rows, keys, given)


def _refuse_misspelt(table: pd.DataFrame) -> None:
    """Refuse a column that is nearly one that is read; others may stand in the table, too."""
    names = ("file", *KEYS, *GIVEN)
    for column in sorted({*map(str, table)}.difference(names)):
        if meant := get_close_matches(column.lower().replace(" ", "_"), names, 1, 0.8):
            raise Refusal(f"column {column!r} is not read; is it {meant[0]!r}?")


def find_logs(paths: Sequence[Path], out: Path | None = None) -> list[Path]:
    """Logs that files and folders stand for, each once: of a folder all below it but the table of answers."""
    answers = os.path.realpath(out) if out else ""
    logs: dict[str, Path] = {}
    for path in paths:
        inside = [path]
        if path.is_dir():
            inside = [
                file
                for file in sorted(path.rglob("*"))
                if file.suffix.lower() in SUFFIXES and file.name[0] != "." and file.is_file()
            ]
        files = {os.path.realpath(file): file for file in inside}
        files.pop(answers, None)
        if not files:
            raise Refusal(f"{path}: no logs in this folder; they end in {', '.join(SUFFIXES)}")
        logs |= files
    return list(logs.values())


def read_rows(source: TableOfLogs) -> pd.DataFrame:
    """Rows of a table of logs: of a CSV file texts, and empty cells as missing."""
    table = source if isinstance(source, pd.DataFrame) else _read_file(str(source))
    table = table.reset_index(drop=table.index.names == [None])
    if "file" not in table:
        raise Refusal(f"no column 'file'; there are {listed(table.columns)}")
    if table.empty or not table.columns.is_unique:
        raise Refusal("no rows" if table.empty else "two of its columns have one name; rename one")
    if len(table) > limits.MOST_LOGS:
        raise Refusal(f"{len(table):,} logs, more than {limits.MOST_LOGS:,}; split the table")
    return table


def _read_file(name: str) -> pd.DataFrame:
    content = read_bytes(name)
    if is_parquet(content):
        return read_parquet(content)
    text, _ = text_of(content)
    first = text.partition("\n")[0]
    check_size(text.count("\n"), len(first))
    delimiter = next((mark for mark in ",;\t" if mark in first), ",")
    rows = csv.DictReader(io.StringIO(text), delimiter=delimiter, restkey=BEYOND)
    table = pd.DataFrame([*rows], columns=[*filter(None, rows.fieldnames or ()), BEYOND])
    return table.replace("", None).dropna(how="all")


def keys_of(table: pd.DataFrame) -> pd.DataFrame:
    """Joints and dates of a table's rows, as far as it has them."""
    keys = table[[name for name in KEYS if name in table]].copy()
    if "date" in keys:
        dates = pd.to_datetime(keys["date"], format="ISO8601", utc=True, errors="coerce")
        keys["date"] = dates.dt.tz_localize(None)
    return keys


def options_of(row: Mapping[Any, Any]) -> dict[str, Any]:
    """What a row says of its log, as `estimate` takes it; an empty cell says nothing.

    Raises
    ------
    Refusal
        A cell is not what its column holds.
    """
    if isinstance(beyond := row.get(BEYOND), list) and any(beyond):
        raise Refusal(f"{beyond[0][:40]!r} stands beyond the header's columns; a decimal comma?")
    if not (row.get("is_dated", True) or pd.isna(row["date"])):
        raise Refusal(f"date is {str(row['date'])[:40]!r}, no date like 2024-03-17")
    return {
        name: _value(name, cell)
        for name, cell in row.items()
        if name in GIVEN and not pd.isna(cell)
    }


def _text(cell: Any) -> str:
    return "" if pd.isna(cell) else str(cell).strip()


def _value(name: str, cell: Any) -> Any:
    """A cell as text, number, or yes and no, by its column's name."""
    if name in _TEXTS:
        return _text(cell)
    wanted = "no number"
    try:
        if name == "trust_period":
            wanted = "neither yes nor no"
            return _TRUTHS[_text(cell).lower()]
        return float(cell)
    except (ValueError, TypeError, KeyError) as error:
        raise Refusal(f"{name} is {str(cell)[:40]!r}, {wanted}") from error
