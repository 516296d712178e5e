"""What keeps a log from being answered: it cannot be used, or it does not tell."""

from importlib import import_module
from typing import Any

from replication.files import UserError


def one_line(text: str) -> str:
    """Text that a file may have a part in, without what a terminal would obey."""
    return "".join(each if each.isprintable() else "?" for each in " ".join(text.split()))


class UnusableLog(UserError, ValueError):
    """A file that no answer can be had from; the message is one line: what is wrong, where, what to do."""

    def __init__(self, problem: str, row: int | None = None):
        self.row = row
        super().__init__(one_line(problem if row is None else f"row {row}: {problem}"))

    def in_file(self, name: str) -> "UnusableLog":
        """The same refusal with the file's name before it."""
        return UnusableLog(f"{name}: {self}" if self.row is None else f"{name}, {self}")


class CannotTell(Exception):
    """A log that can be read and still has no answer: the reason, what says more, and notes on what was done before."""

    def __init__(self, reason: str, detail: str, notes: tuple[str, ...] = ()):
        super().__init__(f"{reason}: {detail}")
        self.notes = notes


# Absence is no answer where the teeth may have stayed on one flank.
NO_REVERSAL = (
    "no load reversal seen",
    "vertical axis? friction above gravity? the test needs a horizontal axis and an off-centre load",
)


def library(name: str, extra: str) -> Any:
    """A library that an installation may lack."""
    try:
        return import_module(name)
    except ImportError as error:
        what = f"{name} is not installed: pip install 'backlash-replication[{extra}]'"
        raise UnusableLog(f"{what}, or keep to CSV") from error
