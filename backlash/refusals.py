"""The one kind of refusal: a reason, and a sentence that says what is wrong, where, and what to do."""

import math
import re
from enum import Enum
from importlib import import_module
from numbers import Real
from typing import Any

from replication.files import UserError


class Reason(Enum):
    """Why there is no answer; all but `UNUSABLE` are those of a log that can be read."""

    UNUSABLE = "unusable log"
    TOO_SHORT = "too short"
    TOO_SLOWLY_SAMPLED = "too slowly sampled"
    NOT_CONSTANT_SPEED = "not constant speed"
    NOT_PERIODIC = "turns differ"
    WRONG_PERIOD = "wrong period"
    NO_TORQUE = "no torque"
    NO_GRAVITY = "no gravity in the torque"
    NO_REVERSAL = "no load reversal seen"
    NO_FIT = "no joint fits"
    AMBIGUOUS = "two backlashes fit"
    TOO_NOISY = "too noisy"
    JOINTS_SIDE = "the joint's side"


class Refusal(UserError, ValueError):
    """No answer: the reason, one sentence, the file and its row, and what was read and done before."""

    def __init__(self, sentence: str, reason: Reason = Reason.UNUSABLE, row: int | None = None):
        super().__init__(sentence)  # by which it travels between processes, with its attributes
        self.sentence = one_line(sentence)
        self.reason = reason
        self.row = row
        self.file = ""
        self.notes: tuple[str, ...] = ()
        self.columns = ""  # of the log that were read, as far as it came

    def __str__(self) -> str:
        kind = "" if self.is_unusable else self.reason.value
        row = "" if self.row is None else f"row {self.row}"
        place = ", ".join(filter(None, (self.file, row)))
        return one_line(": ".join(filter(None, (kind, place, self.sentence))))

    @property
    def is_unusable(self) -> bool:
        """Whether the input cannot be read or used, rather than that it does not tell."""
        return self.reason is Reason.UNUSABLE

    def add(self, what: str) -> None:
        """Say a further thing."""
        self.sentence += f"; {one_line(what)}"

    def add_sheet(self, sheet: str) -> None:
        """Say which sheet of a workbook was read, if there are several."""
        if sheet:
            self.add(f"read was the sheet {sheet}")


def one_line(text: str) -> str:
    """Text that a file may have a part in, without what a terminal would obey."""
    return "".join(each if each.isprintable() else "?" for each in " ".join(text.split()))


def unit_of(keyword: str) -> str:
    """Unit at the end of a keyword of `estimate`; "" if it has none."""
    match = re.search("_(per_s2|kgm2|rad|rps|hz|kg|m|s)$", keyword)
    return match[1] if match else ""


def option_of(keyword: str) -> str:
    """The command line's option for a keyword of `estimate`: its name without the unit."""
    return "--" + keyword.removesuffix(f"_{unit_of(keyword)}").replace("_", "-")


def check_positive(**given: object) -> None:
    """Refuse what is given and no finite number above 0."""
    for name, value in given.items():
        if value is not None and not (isinstance(value, Real) and 0 < float(value) < math.inf):
            raise Refusal(f"{option_of(name)} {value!r}: give a finite number above 0")


def library(name: str, extra: str) -> Any:
    """A library that an installation may lack."""
    try:
        return import_module(name)
    except ImportError as error:
        raise Refusal(
            f"{name} is not installed: pip install 'backlash-replication[{extra}]', or keep to CSV"
        ) from error
