"""Many logs: in folders, or in tables whose cells are text, each converted for its own row alone."""

import io
import os
import re
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import pandas as pd

from backlash.reading.sources import MOST_TABLE_BYTES, name_of, naming, read_bytes
from backlash.reading.tables import decoded
from backlash.refusals import Refusal
from backlash.settings import GIVEN, Settings, settings_for

TableOfLogs: TypeAlias = pd.DataFrame | str | PathLike[str]
KEYS = ["joint", "date"]
SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".log", ".gz", ".parquet", ".xlsx")
_TEXTS = {"joint", "time", "speed", "position", "torque", "unit", "time_unit"}
_TRUTHS = {"yes": True, "true": True, "y": True, "1": True}
_TRUTHS |= {"no": False, "false": False, "n": False, "0": False}


class Batch(NamedTuple):
    """Logs with their settings, or why they have none; `keys` are joints and dates, as far as a table has them."""

    logs: Sequence[Any]
    settings: Sequence[Settings | Refusal]
    keys: pd.DataFrame


def read_batch(source: Sequence[object] | TableOfLogs, given: Mapping[str, Any]) -> Batch:
    """Logs, and what is given of each by its row if they are in a table, else by keywords of `estimate`."""
    if isinstance(source, Sequence) and not isinstance(source, str):
        keys = pd.DataFrame(index=range(len(source)))
        return Batch(source, [settings_for(log, given) for log in source], keys)
    if not isinstance(source, pd.DataFrame | str | PathLike):
        raise Refusal(
            f"one {type(source).__name__} of logs; give a list of them, or a pandas table with the column file"
        )
    table = read_rows(source, "file")
    logs = _paths_of(source, table.pop("file"))
    columns = ("file", *KEYS, *GIVEN)
    if unknown := {*table}.difference(columns):
        raise Refusal(f"{_called(source)}: column {min(unknown)!r}; there are {', '.join(columns)}")
    settings: list[Settings | Refusal] = []
    for log, row in zip(logs, table.to_dict("records"), strict=True):
        try:
            own = {name: cell for name, cell in options_of(row).items() if name not in KEYS}
            settings.append(settings_for(log, {**given, **own}))
        except Refusal as refusal:
            settings.append(Refusal(f"{_called(source)}, {Path(name_of(log)).name}: {refusal}"))
    return Batch(logs, settings, keys_of(table))


def find_logs(paths: Sequence[Path], out: Path | None = None) -> list[Path]:
    """Logs that files and folders stand for, each once: of a folder all below it but the table of answers."""
    answers = os.path.realpath(out or os.devnull)
    logs: dict[str, Path] = {}
    for path in paths:
        inside = sorted(filter(_is_log, path.rglob("*"))) if path.is_dir() else [path]
        found = {os.path.realpath(file): file for file in inside}
        found.pop(answers, None)
        if not found:
            raise Refusal(f"{path}: no logs in this folder; they end in {', '.join(SUFFIXES)}")
        logs |= found
    return list(logs.values())


def _is_log(file: Path) -> bool:
    return file.suffix.lower() in SUFFIXES and not file.name.startswith(".") and file.is_file()


def _paths_of(source: TableOfLogs, names: pd.Series) -> list[Any]:
    """Logs by their names, which in a file are relative to it."""
    if isinstance(source, pd.DataFrame):
        return names.tolist()
    return [Path(source).parent / name.strip() for name in names.fillna("")]


def read_rows(source: TableOfLogs, *columns: str) -> pd.DataFrame:
    """Rows of a table of logs, which has some columns: of a CSV file texts, and empty cells as missing."""
    table = source if isinstance(source, pd.DataFrame) else _read_file(str(source))
    table = table.reset_index(drop=table.index.names == [None])
    if missing := [name for name in columns if name not in table]:
        there = ", ".join(map(repr, table.columns))[:300]
        raise Refusal(f"{_called(source)}: no column {missing[0]!r}; there are {there}")
    if table.empty:
        raise Refusal(f"{_called(source)}: no rows")
    return table


def _read_file(name: str) -> pd.DataFrame:
    with naming(name):
        content = read_bytes(name, MOST_TABLE_BYTES)
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


def keys_of(table: pd.DataFrame) -> pd.DataFrame:
    """Joints, escaped as names of files are, and dates of a table's rows, as far as it has them."""
    keys = table[[name for name in KEYS if name in table]].copy()
    if "joint" in keys:
        keys["joint"] = keys["joint"].map(escape, na_action="ignore")
    if "date" in keys:
        keys["date"] = _as_dates(keys["date"])
    return keys


def _as_dates(cells: pd.Series) -> pd.Series:
    return pd.to_datetime(cells, format="ISO8601", utc=True, errors="coerce").dt.tz_localize(None)


def escape(name: object) -> str:
    """A name that a table can hold, and that is no formula for a spreadsheet."""
    return re.sub(r"^(?=[=+@\s-])", "'", str(name).encode(errors="replace").decode())


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


def _called(source: TableOfLogs) -> str:
    """What a table is called in a refusal."""
    return "the table" if isinstance(source, pd.DataFrame) else str(source)
