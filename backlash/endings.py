"""How a command ends: by an answer, an error, or Ctrl-C; never with a traceback."""

import errno
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from backlash.refusals import Refusal, one_line

DEFECT = 1
UNUSABLE = 2
_INTERRUPTED = 130
# Of an output that takes no more: whoever read a pipe has seen enough, or a disk is full.
UNWRITABLE = {errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EIO}


def ending(error: BaseException) -> tuple[int, str]:
    """Exit status that an error ends a command with, and the line that says why."""
    for each in (error, error.__cause__, error.__context__):
        if isinstance(each, KeyboardInterrupt):
            return _INTERRUPTED, f"interrupted{each}"
    if isinstance(error, Refusal):
        return UNUSABLE, str(error)
    if isinstance(error, OSError) and error.errno in UNWRITABLE:
        # Nothing is left to be flushed at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        is_read = error.errno != errno.EPIPE
        return DEFECT, f"the answer cannot be written ({error.strerror})" if is_read else ""
    if isinstance(error, OSError) and error.filename is not None:
        return UNUSABLE, one_line(f"{error.filename}: {error.strerror}; check the name")
    if isinstance(error, MemoryError):
        return UNUSABLE, "too large for this machine's memory; cut it to the test movement"
    import traceback

    place = traceback.extract_tb(error.__traceback__)[-1]
    what = f"{type(error).__name__}: {error} ({Path(place.filename).name}, line {place.lineno})"
    return DEFECT, one_line(f"a defect of the program, please report it: {what}")


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
