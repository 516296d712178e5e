"""Which columns of a log's table are what, in which units: names, options and numbers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from backlash.reading.tables import Table
from backlash.reading.units import KNOWN, PER_TURN, SECONDS, UNITS, split_unit, words_of
from backlash.refusals import Refusal, check_positive
from replication.signature import FloatArray

_POSITIVE = (
    *("counts_per_turn", "commanded_speed_rps", "turn_period_s", "gear_ratio", "rate_hz"),
    "ring_hz",
)
_MOST = 1e30  # of what is measured; its square is a number, too


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
    # Motor turns in a load turn; 1 where the log has the joint's side.
    gear_ratio: float | None = None
    start_s: float = 0.0  # of the part to use, from the log's first sample on
    end_s: float = np.inf
    torque: str | None = None  # of the motor, in any unit
    ring_hz: float = 21.0  # of the oscillation after an impact; that of the paper's joint

    def __post_init__(self):
        """Refuse what no log could be read with, in one line."""
        check_positive(**{name: getattr(self, name) for name in _POSITIVE})
        if self.turn_period_s is None and self.gear_ratio is None:
            raise Refusal("the load's turn is not known: give --turn-period (in s) or --gear-ratio")
        if self.speed is not None and self.position is not None:
            raise Refusal("--speed and --position: give one of them")
        if self.unit is not None and self.unit not in UNITS:
            raise Refusal(f"--unit {self.unit}: there are {', '.join(UNITS)}")
        if not self.start_s < self.end_s:
            part = f"--from {self.start_s!r} --to {self.end_s!r}"
            raise Refusal(f"{part}: give seconds, the end after the start")

    @property
    def expected_speed_rps(self) -> float | None:
        """Motor speed that the rest implies [rps]."""
        if self.commanded_speed_rps is None and self.gear_ratio and self.turn_period_s:
            return self.gear_ratio / self.turn_period_s
        return self.commanded_speed_rps

    def period_s(self, speed_rps: float) -> float:
        """Period of a load turn [s]: the one given, or by the gear ratio at a motor speed."""
        return self.turn_period_s or (self.gear_ratio or np.nan) / speed_rps


@dataclass(frozen=True)
class Columns:
    """Which columns of a file were read, in which units, and of which side of the gear."""

    time: str = ""  # empty where the rate was given
    time_unit: str = ""
    signal: str = ""
    unit: str = ""
    is_position: bool = False
    torque: str = ""
    sheet: str = ""  # of a workbook with several
    is_links: bool = False  # the joint's side of the gear

    def describe(self) -> str:
        """As every answer names them; empty for a record that was no file's."""
        if not self.signal:
            return ""
        what = "position" if self.is_position else "speed"
        parts = [
            f"time {self.time!r} [{self.time_unit}]" if self.time else "time by --rate",
            f"{what} {self.signal!r} [{self.unit}]",
            *([f"torque {self.torque!r}"] if self.torque else []),
            *([f"sheet {self.sheet}"] if self.sheet else []),
            "the joint's side" if self.is_links else "the motor's side",
        ]
        return ", ".join(parts)


def choose_columns(table: Table, form: LogFormat) -> Columns:
    """Choose the columns of time, of speed or position, and of the torque; ask where several may be meant."""
    columns = list(table.frame.columns)
    filled = [column for column in columns if table.frame[column].notna().any()]
    time = ""
    if not form.rate_hz:
        time = given_column(columns, form.time) if form.time else _time_column(filled, table.frame)
    torque = given_column(columns, form.torque) if form.torque else ""
    given = form.speed or form.position
    if given:
        signal, is_position = given_column(columns, given), form.position is not None
    else:
        signal, is_position = _signal_column(
            [name for name in filled if name not in (time, torque)]
        )
    if signal in (time, torque) or time == torque != "":
        raise Refusal(
            f"time {time!r}, signal {signal!r} and torque {torque!r} cannot be one column"
        )
    if time and torque:
        _refuse_other_stamps(table.frame, time, torque)
    is_links = form.gear_ratio == 1 or bool(words_of(signal) & {*KNOWN["sides"]["link"]})
    if is_links and form.gear_ratio not in (None, 1) and not given:
        cure = "--speed or --position with the motor's column, or --gear-ratio 1"
        raise Refusal(
            f"{signal!r} is the joint's side of the gear by its name, "
            f"--gear-ratio {form.gear_ratio:g} needs the motor's; give {cure}"
        )
    unit = _unit_of(signal, is_position, form)
    return Columns(time, "", signal, unit, is_position, torque, table.sheet, is_links)


def _refuse_other_stamps(frame: pd.DataFrame, time: str, torque: str) -> None:
    """Refuse a torque that has time stamps of its own beside it, as traces of a PLC have."""
    at = list(frame.columns).index(torque)
    for other in {*frame.columns[max(at - 1, 0) : at + 2]} - {time, torque}:
        is_time = split_unit(other)[1] in SECONDS or split_unit(other)[0] == split_unit(time)[0]
        if is_time and not frame[other].equals(frame[time].rename(other)):
            raise Refusal(
                f"torque {torque!r} has time stamps of its own in {other!r}; "
                "export speed and torque at the same instants"
            )


def given_column(columns: Sequence[str], given: str) -> str:
    """Find a column by its name, with or without its unit, or by its number in the file, from 1."""
    given = str(given)
    for spell in (str, str.lower, lambda column: split_unit(column)[0]):
        same = [column for column in columns if spell(column) in (given, given.lower())]
        if len(same) == 1:
            return same[0]
    if given.isdigit() and 1 <= int(given) <= len(columns):
        return columns[int(given) - 1]
    raise Refusal(f"no column {given!r}; there are {_listed(columns)}")


def _listed(columns: Sequence[str]) -> str:
    return ", ".join(map(repr, columns))[:300] or "none"


def _named_as(columns: Sequence[str], what: str) -> list[str]:
    """Columns that are called a name of `what`, or have one of more than a letter as a word."""
    names = set(KNOWN["names"][what])
    words = {name for name in names if len(name) > 1}
    return [
        column for column in columns if split_unit(column)[0] in names or words_of(column) & words
    ]


def _best(columns: list[str], rank: Callable[[str], tuple[bool, ...]]) -> list[str]:
    """The columns of the highest rank."""
    highest = max(map(rank, columns), default=())
    return [column for column in columns if rank(column) == highest]


def _signal_column(columns: Sequence[str]) -> tuple[str, bool]:
    """The measured speed, else position, of the motor's side if a name tells; and whether it is a position."""
    if columns and all(map(str.isdigit, columns)):
        if len(columns) == 1:
            return columns[0], False
        raise Refusal(
            f"{len(columns)} columns besides the time, without names; "
            "give --time and --speed by number, and --unit"
        )
    motor, link = ({*KNOWN["sides"][side]} for side in ("motor", "link"))
    measured = [name for name in columns if not words_of(name) & {*KNOWN["no_measurement"]}]
    speeds = _named_as(measured, "speed")
    either = _best(
        speeds + _named_as(measured, "position"),
        lambda name: (bool(words_of(name) & motor), not words_of(name) & link, name in speeds),
    )
    if not either:
        raise Refusal(
            f"no column of a measured speed or position among {_listed(columns)}; give --speed"
        )
    what = "speed" if either[0] in speeds else "position"
    if len(either) > 1:
        raise Refusal(f"which column is the motor's {what}: {_listed(either)}? give --{what}")
    return either[0], what == "position"


def _time_column(columns: Sequence[str], frame: pd.DataFrame) -> str:
    """The column of time stamps; of several that of the sample before that of its receipt."""
    if all(map(str.isdigit, columns)) and len(columns) > 1:
        return columns[0]
    named = _named_as(columns, "time")
    if len(named) > 1 and named[-1].lower().endswith(("nsec", "nsecs", "nanosec")):
        raise Refusal(
            f"{named[-1]!r} is a part of a stamp in two columns; export it as one, in s or ns, or give --rate"
        )
    named = _best(
        named,
        lambda name: (
            "header" in words_of(name),
            split_unit(name)[0] in KNOWN["names"]["time"],
            not name.startswith("__"),
            not words_of(name) & {*KNOWN["received"]},
            split_unit(name)[0] != "date",
        ),
    )
    if not named:
        raise Refusal(f"no column of time among {_listed(columns)}; give --time, or --rate")
    stamps = frame[named].dropna()
    if stamps.ne(stamps[named[0]], axis=0).any(axis=None):
        raise Refusal(f"which column is the time: {_listed(named)}? give --time")
    return named[0]


def numbers(table: pd.DataFrame, column: str) -> FloatArray:
    """A column as finite numbers."""
    values = table[column]
    result = pd.to_numeric(values, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
    bad = np.flatnonzero(~(np.abs(result) < _MOST))
    if bad.size:
        cell = values.iloc[bad[0]]
        what = (
            "is missing" if pd.isna(cell) else f"is {str(cell)[:40]!r}, no number of a measurement"
        )
        raise Refusal(f"{column} {what}; mend or cut the log there", row=table.index[bad[0]])
    return result


def _unit_of(column: str, is_position: bool, form: LogFormat) -> str:
    """Unit of a speed or position: the name's or the one that is given, never a guess."""
    named = split_unit(column)[1]
    if named in KNOWN["spellings"] and form.unit and PER_TURN.get(named) != PER_TURN.get(form.unit):
        raise Refusal(
            f"column {column!r} says {named}, --unit says {form.unit}; leave --unit out, or rename"
        )
    unit = form.unit or named or ("counts" if form.counts_per_turn else "")
    if unit not in KNOWN["spellings"] or (is_position and unit == "rpm"):
        which = f"the unit {unit!r} of {column!r}" if unit else f"the unit of {column!r}"
        turns = "rps for turns, rad/s for rad, or counts"
        those = turns if is_position else f"one of {', '.join(UNITS)}"
        raise Refusal(f"{which} is not known; give --unit ({those})")
    if unit == "counts" and form.counts_per_turn is None:
        raise Refusal("counts need the encoder's counts of a motor turn; give --counts-per-turn")
    return unit
