"""The virtual sensor's command line: `backlash estimate`, `calibrate` and `trend`."""

import argparse
import errno
import json
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

from backlash.fitting import METHODS, SENSOR_METHODS
from backlash.reading import UNITS
from backlash.reading.refusals import UnusableLog, one_line

_ABOUT = (
    "Backlash, half of the total play, of a robot's joint from logs of the motor encoder and torque. The test needs "
    "a horizontal axis, an off-centre load whose gravity is above its friction, and at constant speed four turns or "
    "more in one direction, or with the torque six strokes or more to and fro across the vertical."
)
_DEFECT = 1
_UNUSABLE = 2
_INTERRUPTED = 130
_STATUS = f"Exit status: 0 done, 1 a defect, 2 unusable input, 3 --fail-on holds, {_INTERRUPTED} interrupted."
# Of an output that takes no more: whoever read a pipe has seen enough, or a disk is full.
UNWRITABLE = {errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EIO}


def main(arguments: list[str] | None = None) -> int:
    """Run one command of the sensor; whatever happens, no traceback."""
    if sys.stdout is None:
        print("the answer cannot be written (the standard output is closed)", file=sys.stderr)
        return _DEFECT
    try:
        with ends_on_interrupt():
            try:
                options = _parser().parse_args(arguments)
                return getattr(import_module("backlash.commands"), f"run_{options.command}")(
                    options
                )
            finally:
                sys.stdout.flush()
    except (Exception, KeyboardInterrupt) as error:
        status, line = _ending(error)
        if line:
            print(line, file=sys.stderr)
        return status


def _ending(error: BaseException) -> tuple[int, str]:
    """Exit status that an error ends a command with, and the line that says why."""
    for each in (error, error.__cause__, error.__context__):
        if isinstance(each, KeyboardInterrupt):
            return _INTERRUPTED, f"interrupted{each}"
    if isinstance(error, UnusableLog):
        return _UNUSABLE, str(error)
    if isinstance(error, OSError) and error.errno in UNWRITABLE:
        # Nothing is left to be flushed at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        is_read = error.errno != errno.EPIPE
        return _DEFECT, f"the answer cannot be written ({error.strerror})" if is_read else ""
    import traceback

    place = traceback.extract_tb(error.__traceback__)[-1]
    what = f"{type(error).__name__}: {error} ({Path(place.filename).name}, line {place.lineno})"
    return _DEFECT, f"a defect of the program, please report it: {' '.join(what.split())}"


@contextmanager
def ends_on_interrupt(note: str = "") -> Iterator[None]:
    """End the program on Ctrl-C, with one line; compiled code would make an exception another."""

    def end(number: int, frame: object) -> None:
        from multiprocessing import active_children

        if active_children():  # they compute, this process waits for them and has to end them
            raise KeyboardInterrupt(note)
        os.write(2, f"interrupted{note}\n".encode())
        os._exit(_INTERRUPTED)

    before = signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


_MEANT = {
    "path": Path,
    "number": float,
    "whole number": int,
    "units": UNITS,
    "methods": SENSOR_METHODS,
    "calibrated methods": METHODS,
}


class _OneLineParser(argparse.ArgumentParser):
    def error(self, message: str):
        """Say in one line what is wrong with the arguments, and exit."""
        self.exit(_UNUSABLE, one_line(f"{self.prog}: {message}; see --help") + "\n")


def _parser() -> argparse.ArgumentParser:
    """The commands and options of `data/options.json`; words there stand for types and choices."""
    known = json.loads(Path(__file__).with_name("data").joinpath("options.json").read_text("utf-8"))
    parser = _OneLineParser(prog="backlash", description=_ABOUT, epilog=_STATUS)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command")
    for command, said in known["commands"].items():
        sub = commands.add_parser(command, help=said["help"])
        for name in said["groups"]:
            group = known["groups"][name]
            titled = {key: group[key] for key in ("title", "description") if key in group}
            place = sub.add_argument_group(**titled) if titled else sub
            for option, how in group["options"].items():
                meant = {key: _MEANT[how[key]] for key in how if str(how[key]) in _MEANT}
                place.add_argument(option, **how | meant)
    return parser
