"""The virtual sensor's command line: `backlash estimate`."""

import errno
import io
import os
import sys
import traceback
import warnings
from pathlib import Path

from backlash.cli.options import Exit, parser
from backlash.example import write_example
from backlash.refusals import one_line
from replication.compilation import pinned_environment
from replication.files import DISK_IS_FULL, UserError

# Of an output that takes no more: whoever read a pipe has seen enough, or a disk is full.
_UNWRITABLE = {errno.EPIPE, errno.EIO, *DISK_IS_FULL}


def main(arguments: list[str] | None = None) -> int:
    """Run one command of the sensor; whatever happens, no traceback, and no library's warnings."""
    # Read when NumPy and numba are imported, below: answers are the same on every x86-64 processor with AVX2. Whoever
    # chooses a kernel gets that.
    if not os.environ.keys() & {"OPENBLAS_CORETYPE", "NUMBA_CPU_NAME", "NPY_DISABLE_CPU_FEATURES"}:
        os.environ |= pinned_environment()
    # Plots are written to files, whatever the user's settings of matplotlib are.
    os.environ |= {"MPLBACKEND": "agg", "MATPLOTLIBRC": os.devnull}
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # which may take ASCII only
            stream.reconfigure(errors="replace")
    try:
        with warnings.catch_warnings(action="ignore"):
            if sys.stdout is None:
                raise UserError("the standard output is closed; send it to a file or to /dev/null")
            options = parser().parse_args(arguments)
            if options.command == "example":
                print(f"Its backlash is 0.8 mrad. Now ask for it:\n{write_example()}")
                return Exit.DONE
            from backlash.cli.estimate_logs import run  # what only a right command needs

            status = run(options)
            sys.stdout.flush()
            return status
    except (Exception, KeyboardInterrupt) as error:
        status, line = _ending(error)
        if line:
            print(line, file=sys.stderr)
        return status


def _ending(error: BaseException) -> tuple[int, str]:
    """Exit status that an error ends a command with, and the line that says why."""
    causes = (error, error.__cause__, error.__context__)  # compiled code makes Ctrl-C a cause
    if any(isinstance(each, KeyboardInterrupt) for each in causes):
        return Exit.INTERRUPTED, "interrupted; with --out the same command goes on"
    if isinstance(error, UserError):
        return Exit.UNUSABLE, str(error)
    if isinstance(error, OSError) and error.errno in _UNWRITABLE:
        # Nothing is left to be flushed at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        why = f"the answer cannot be written ({error.strerror})"
        return Exit.DEFECT, "" if error.errno == errno.EPIPE else why
    if isinstance(error, OSError) and error.filename is not None:
        return Exit.UNUSABLE, one_line(f"{error.filename}: {error.strerror}; check the name")
    if isinstance(error, MemoryError):
        return Exit.UNUSABLE, "too large for this machine's memory; cut it to the test movement"
    place = traceback.extract_tb(error.__traceback__)[-1]
    what = f"{type(error).__name__}: {error} ({Path(place.filename).name}, line {place.lineno})"
    return Exit.DEFECT, one_line(f"a defect of the program, please report it: {what}")
