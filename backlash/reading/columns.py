"""Which columns of a log's table are what, in which units: names, options and numbers."""

import json
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, fields
from numbers import Real
from pathlib import Path

import numpy as np
import pandas as pd

from backlash.reading import UNITS
from backlash.refusals import Refusal
from replication.arrays import FloatArray

_POSITIVE = {
    "counts_per_turn": "--counts-per-turn",
    "commanded_speed_rps": "--commanded-speed",
    "turn_period_s": "--turn-period",
    "gear_ratio": "--gear-ratio",
    "rate_hz": "--rate",
    "speed_tolerance": "--speed-tolerance",
}
# What loggers call columns, units, and how they spell these.
_KNOWN = json.loads(
    Path(__file__).parents[1].joinpath("data", "column_names.json").read_text("utf-8")
)
PER_TURN: dict[str, float] = _KNOWN["per_turn"]
_LONGEST_NAME = 200  # of a column; the rest says nothing
_SECONDS: dict[str, float] = _KNOWN["seconds"]


def is_positive(value: object) -> bool:
    """Whether a value is a finite number above 0."""
    return isinstance(value, Real) and 0 < float(value) < np.inf


@dataclass(frozen=True)
class LogFormat:
    """What the user says of a log; None is left to be found.

    Columns go by name or by number from 1; `turn_period_s` or `gear_ratio` is needed.
    """

    time: str | None = None
    rate_hz: float | None = None  # of the samples, without time stamps or in place of them
    speed: str | None = None  # of the motor
    position: str | None = None  # of the motor, instead of its speed
    # Of the speed, one of `UNITS`; of a position the turns, radians or counts that go with it.
    unit: str | None = None
    time_unit: str | None = None  # of the time stamps, as s or ms
    counts_per_turn: float | None = None  # of the encoder, in a motor turn
    commanded_speed_rps: float | None = None  # of the motor
    turn_period_s: float | None = None  # of the load
    trust_period: bool = False  # whether the turn is taken as it is given
    gear_ratio: float | None = (
        None  # motor turns in a load turn; 1 where the log has the joint's side
    )
    speed_tolerance: float = 0.03  # of a constant speed; backlash disturbs it by some 1 %
    start_s: float | None = None  # of the part to use, from the log's first sample on
    end_s: float | None = None
    torque: str | None = None  # of the motor, in any unit

    def __post_init__(self):
        """Refuse what no log could be read with, in one line."""
        for name, option in _POSITIVE.items():
            value = getattr(self, name)
            if value is not None and not is_positive(value):
                raise Refusal(f"{option} {value!r}: give a finite number above 0")
        if self.turn_period_s is None and self.gear_ratio is None:
            raise Refusal("the load's turn is not known: give --turn-period (in s) or --gear-ratio")
        if self.speed is not None and self.position is not None:
            raise Refusal("--speed and --position: give one of them")
        if self.unit is not None and self.unit not in UNITS:
            raise Refusal(f"--unit {self.unit}: there are {', '.join(UNITS)}")
        part = self.start_s or 0.0, np.inf if self.end_s is None else self.end_s
        if not (all(isinstance(end, Real) for end in part) and part[0] < part[1]):
            raise Refusal(
                f"--from {self.start_s!r} --to {self.end_s!r}: give seconds, the end after the start"
            )

    @property
    def expected_speed_rps(self) -> float | None:
        """Motor speed that the rest implies [rps]."""
        if self.commanded_speed_rps is None and self.gear_ratio and self.turn_period_s:
            return self.gear_ratio / self.turn_period_s
        return self.commanded_speed_rps

    def period_s(self, speed_rps: float) -> float:
        """Period of a load turn [s]: the one given, or by the gear ratio at a motor speed."""
        return self.turn_period_s or (self.gear_ratio or np.nan) / speed_rps


# What the user may say, by its name.
SAID = [field.name for field in fields(LogFormat)]


def _known_unit(text: str) -> str:
    """A unit's one name, from any of its spellings; "" if it is none."""
    text = unicodedata.normalize("NFKC", text.strip()).lower()
    spelled = (
        unit
        for unit, spelling in _KNOWN["spellings"].items()
        if re.fullmatch(spelling.format(**_KNOWN), text)
    )
    return text if text in _SECONDS else next(spelled, "")


def _plain(column: str) -> tuple[str, str]:
    """Name of a column in lower case without its unit, and the unit: from "Motor speed [rpm]" and "speed_rad_s"."""
    column = column[:_LONGEST_NAME]
    text = (
        re.sub(r"(?<=[a-z])(?=[A-Z])", "_", re.sub(r"\s*[\[(]\d+[\])]$", "", column))
        .strip(" _%")
        .lower()
    )
    bracketed = re.fullmatch(r"(.*?)[\s_]*[\[(<](.*?)[\])>](.*)", text)
    if bracketed and (not bracketed[3] or _known_unit(bracketed[2])):
        return bracketed[1] + bracketed[3], _known_unit(bracketed[2]) or bracketed[2].strip()
    for gap in re.finditer(r"[\s_]+", text):
        if unit := _known_unit(text[gap.end() :]):
            return text[: gap.start()].replace("_", " "), unit
    return text, _known_unit(text)


def _listed(columns: Sequence[str]) -> str:
    return ", ".join(map(repr, columns))[:300]


def given_column(columns: Sequence[str], given: str) -> str:
    """Find a column by its name, or by its number from 1."""
    given = str(given)
    if given in columns:
        return given
    same = [column for column in columns if column.lower() == given.lower()]
    if len(same) == 1:
        return same[0]
    if given.isdigit() and 1 <= int(given) <= len(columns):
        return columns[int(given) - 1]
    raise Refusal(f"no column {given!r}; there are {_listed(columns)}")


def _column_like(columns: Sequence[str], what: str) -> str | None:
    """Find the only column, or the motor's, that is called a name of `what` or has one in its name."""
    names = set(_KNOWN["names"][what])
    words = {
        column: set(re.split(r"[\s_./]+|(?<=[a-z])(?=[\d\[])", _plain(column)[0]))
        for column in columns
    }
    exact = [column for column in columns if _plain(column)[0] in names]
    fitting = exact or [column for column in columns if words[column] & names]
    fitting = [column for column in fitting if "motor" in words[column]] or fitting
    if len(fitting) > 1:
        raise Refusal(f"which column is the {what}: {_listed(fitting)}? give --{what}")
    return fitting[0] if fitting else None


def choose_columns(table: pd.DataFrame, form: LogFormat) -> tuple[str | None, str, bool]:
    """Columns of time, unless the rate is known, and of speed or position, and whether it is a position."""
    columns = list(table.columns)
    least = 1 if form.rate_hz else 2
    if len(columns) < least:
        raise Refusal(
            "one column; a log needs time and motor speed, or time and position, or --rate"
        )
    given = form.speed or form.position
    nameless = all(column.isdigit() for column in columns)
    if nameless and given is None:
        if len(columns) > 2:
            raise Refusal(
                f"{len(columns)} columns without names; give --time and --speed by number"
            )
        return columns[0], columns[-1], False
    time = _time_column(columns, form, nameless)
    if given is not None:
        column = given_column(columns, given)
        if column in (time, form.torque):
            raise Refusal(f"column {column!r} cannot be both the time or torque and the signal")
        return time, column, form.position is not None
    rest = [column for column in columns if column not in (time, form.torque)]
    speed = _column_like(rest, "speed")
    signal = speed or _column_like(rest, "position")
    if signal is None:
        raise Refusal(f"no column of speed or position among {_listed(columns)}; give --speed")
    return time, signal, speed is None


def _time_column(columns: Sequence[str], form: LogFormat, nameless: bool) -> str | None:
    given = form.time or ("1" if nameless else None)
    if form.rate_hz and not form.time:
        exact = [column for column in columns if _plain(column)[0] in _KNOWN["names"]["time"]]
        return exact[0] if exact else None
    time = given_column(columns, given) if given else _column_like(columns, "time")
    if time is None:
        raise Refusal(f"no column of time among {_listed(columns)}; give --time, or --rate")
    return time


def with_whole_stamps(table: pd.DataFrame) -> pd.DataFrame:
    """A table with one column for a stamp that comes in seconds and nanoseconds."""
    for nano in [column for column in table.columns if re.search(r"stamp\Wn(ano)?secs?$", column)]:
        whole = re.sub("n(ano)?sec", "sec", nano)
        if whole in table:
            stamp = 10**9 * table[whole] + table[nano]
            table = table.drop(columns=[whole, nano]).assign(**{"stamp [ns]": stamp})
    return table


def numbers(table: pd.DataFrame, column: str) -> FloatArray:
    """A column as finite numbers."""
    values = table[column]
    found = pd.to_numeric(values, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
    bad = np.flatnonzero(~np.isfinite(found))
    if bad.size:
        cell = values.iloc[bad[0]]
        what = (
            "is missing or not a number (NaN)"
            if pd.isna(cell)
            else f"is {str(cell)[:40]!r}, no finite number"
        )
        raise Refusal(f"{column} {what}; mend or cut the log there", row=table.index[bad[0]])
    if np.abs(found).max(initial=0.0) > 1e30:
        raise Refusal(f"{column} has values above 1e30; that is no measurement")
    return found


def seconds(
    table: pd.DataFrame, column: str, given_unit: str | None = None
) -> tuple[FloatArray, tuple[str, ...]]:
    """Time stamps [s] from the first one on, from date-times too, and a note on their unit."""
    values = table[column]
    if pd.api.types.is_timedelta64_dtype(values):
        return (values - values.iloc[0]).dt.total_seconds().to_numpy(dtype=float), ()
    if not pd.api.types.is_numeric_dtype(values):
        text = (
            values.astype(str)
            .str.replace(",", ".")
            .str.replace(r"^(?=\d\d:)", "1970-01-01 ", regex=True)
        )
        text = text.str.replace(r"^(\d\d)\.(\d\d)\.(\d{4})", r"\3-\2-\1", regex=True)
        dates = pd.to_datetime(text, errors="coerce", utc=True, format="ISO8601")
        if dates.notna().mean() > 0.5:
            if dates.isna().any():
                row = table.index[np.flatnonzero(dates.isna())[0]]
                raise Refusal(f"{column} is no date-time; mend or cut the log there", row=row)
            return (dates - dates.iloc[0]).dt.total_seconds().to_numpy(dtype=float), ()
    stamps, unit = numbers(table, column), given_unit or _plain(column)[1]
    if unit and unit not in _SECONDS:
        raise Refusal(
            f"the unit {unit!r} of {column!r} is not known; there are {', '.join(_SECONDS)}"
        )
    if not unit and stamps.size:  # since 1970, from 2001 on
        unit = next((u for u in ("ms", "us", "ns") if 1e9 <= stamps[0] * _SECONDS[u] < 1e10), "")
    if pd.api.types.is_integer_dtype(values):  # nanoseconds since 1970 are more than a float holds
        stamps = (values - values.iloc[0]).to_numpy(dtype=float)
    notes = () if _SECONDS.get(unit, 1.0) == 1.0 else (f"time stamps read in {unit}",)
    return _SECONDS.get(unit, 1.0) * (stamps - stamps[:1]), notes


def unit_of(column: str, is_position: bool, form: LogFormat) -> tuple[str, tuple[str, ...]]:
    """Unit of a speed or position, and a note if that is a guess."""
    said = _plain(column)[1]
    if said in _KNOWN["spellings"] and form.unit and PER_TURN.get(said) != PER_TURN.get(form.unit):
        raise Refusal(
            f"column {column!r} says {said}, --unit says {form.unit}; leave --unit out, or rename"
        )
    unit = form.unit or said or ("counts" if form.counts_per_turn else "")
    if unit not in ("", *_KNOWN["spellings"]):
        raise Refusal(
            f"the unit {unit!r} of {column!r} is not known; give --unit, one of {', '.join(UNITS)}"
        )
    if unit == "" and is_position:
        raise Refusal(
            f"the unit of {column!r} is not known; give --unit (rps for turns, rad/s for rad)"
        )
    if unit == "counts" and form.counts_per_turn is None:
        raise Refusal("counts need the encoder's counts of a motor turn; give --counts-per-turn")
    if is_position and unit == "rpm":
        raise Refusal(
            "a position has no unit rpm; give --unit rps for turns, rad/s for rad, or counts"
        )
    return unit or "rps", () if unit else ("unit of the speed not said: taken as rps",)
