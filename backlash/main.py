"""The virtual sensor's command line: `backlash estimate`, `calibrate` and `trend`."""

import io
import os
import sys
import warnings
from importlib import import_module

from backlash.endings import DEFECT, ending, ends_on_interrupt
from backlash.options import parser

# Threads for matrices of ten rows cost more than they save; read when NumPy is imported, later.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main(arguments: list[str] | None = None) -> int:
    """Run one command of the sensor; whatever happens, no traceback, and no library's warnings."""
    if sys.stdout is None:
        print("the answer cannot be written (the standard output is closed)", file=sys.stderr)
        return DEFECT
    os.environ["MPLBACKEND"] = "agg"  # plots are written to files, whatever the user's backend is
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # which may take ASCII only
            stream.reconfigure(errors="replace")
    try:
        with ends_on_interrupt(), warnings.catch_warnings(action="ignore"):
            try:
                options = parser().parse_args(arguments)
                commands = import_module("backlash.commands")
                return getattr(commands, f"run_{options.command}")(options)
            finally:
                sys.stdout.flush()
    except (Exception, KeyboardInterrupt) as error:
        status, line = ending(error)
        if line:
            print(line, file=sys.stderr)
        return status
