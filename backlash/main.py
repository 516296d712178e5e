"""The virtual sensor's command line: `backlash estimate`, `calibrate` and `trend`."""

import argparse
import errno
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


class _OneLineParser(argparse.ArgumentParser):
    def error(self, message: str):
        """Say in one line what is wrong with the arguments, and exit."""
        self.exit(_UNUSABLE, one_line(f"{self.prog}: {message}; see --help") + "\n")


def _parser() -> argparse.ArgumentParser:
    parser = _OneLineParser(prog="backlash", description=_ABOUT, epilog=_STATUS)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command")
    for add in (_add_estimate, _add_calibrate, _add_trend):
        add(commands)
    return parser


def _add_estimate(commands: argparse._SubParsersAction) -> None:
    sub = commands.add_parser(
        "estimate", help="backlash (half of the play) from logs of the motor encoder"
    )
    sub.add_argument(
        "log",
        nargs="*",
        type=Path,
        help="CSV, XLSX or Parquet files, or folders of them; - is the standard input",
    )
    sub.add_argument(
        "--batch",
        type=Path,
        metavar="TABLE",
        help="CSV or Parquet with the column file, and joint, date, turn_period_s, gear_ratio, torque, "
        "inertia_ratio, gravity_per_s2 (or motor_inertia_kgm2, load_mass_kg, load_arm_m, load_inertia_kgm2), "
        "calibration, ...: each log with its own",
    )
    _add_log_options(sub)
    _add_measuring(sub)
    sub.add_argument(
        "--json", action="store_true", help="print an array with an object for each log"
    )
    sub.add_argument(
        "--plot",
        type=Path,
        metavar="FILE",
        help="write a figure of the one log: .png, .svg or .pdf",
    )
    sub.add_argument(
        "--out", type=Path, metavar="TABLE", help="write a table, one row per log: .csv or .parquet"
    )
    sub.add_argument(
        "--dask", metavar="ADDRESS", help="scheduler of a cluster that takes the place of --jobs"
    )
    sub.add_argument(
        "--fail-on",
        metavar="LIST",
        help="exit with 3 if a log is one of these: cannot-tell, no-backlash, backlash, "
        "backlash>0.5mrad (half of the play)",
    )


def _add_calibrate(commands: argparse._SubParsersAction) -> None:
    sub = commands.add_parser("calibrate", help="a calibration from logs of known backlash")
    sub.add_argument(
        "table",
        type=Path,
        help="CSV with the columns log (its file) and backlash_rad (half of the play), six different ones or more",
    )
    sub.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="the calibration, .json"
    )
    sub.add_argument("--method", choices=METHODS, default="waveform", help="default: waveform")
    _add_log_options(sub)
    _add_searches(sub)


def _add_trend(commands: argparse._SubParsersAction) -> None:
    sub = commands.add_parser("trend", help="growth of the backlash, and when it crosses a limit")
    sub.add_argument(
        "log", nargs="+", type=Path, help="logs or folders, dates in their names, like 2024-03-17"
    )
    sub.add_argument(
        "--dates", type=Path, metavar="TABLE", help="CSV with the columns file and date instead"
    )
    sub.add_argument(
        "--limit",
        type=float,
        metavar="RAD",
        help="the backlash (half of the play) whose date is wanted, in rad: 0.001 for 1 mrad",
    )
    sub.add_argument(
        "--relative",
        action="store_true",
        help="growth of the oscillation's amplitude in percent, for a joint whose backlash cannot be told",
    )
    _add_log_options(sub)
    _add_measuring(sub)
    sub.add_argument("--json", action="store_true", help="print an object")
    sub.add_argument("--plot", type=Path, metavar="FILE", help="write a figure: .png, .svg or .pdf")


def _add_log_options(sub: argparse.ArgumentParser) -> None:
    """Options that are fields of `LogFormat`, under their names there."""
    group = sub.add_argument_group("the logs")
    group.add_argument(
        "--time", metavar="COLUMN", help="by name, or by number from 1; found by name otherwise"
    )
    group.add_argument("--time-unit", choices=("s", "ms", "us", "ns"), help="of the time stamps")
    group.add_argument("--speed", metavar="COLUMN", help="of the motor")
    group.add_argument("--position", metavar="COLUMN", help="of the motor, instead of its speed")
    group.add_argument(
        "--unit", choices=UNITS, help="of the speed; of a position: rps for turns, rad/s for rad"
    )
    for option, name, metavar, text in (
        ("--counts-per-turn", "counts_per_turn", "N", "encoder counts of a motor turn"),
        (
            "--commanded-speed",
            "commanded_speed_rps",
            "RPS",
            "of the motor [rps], to check the unit by",
        ),
        ("--turn-period", "turn_period_s", "S", "of the load [s]"),
        ("--gear-ratio", "gear_ratio", "N", "motor turns in a load turn, instead or too"),
        ("--from", "start_s", "S", "leave out what is before this time [s from the first sample]"),
        ("--to", "end_s", "S", "leave out what is after this time"),
    ):
        group.add_argument(option, dest=name, type=float, metavar=metavar, help=text)
    group.add_argument(
        "--trust-period",
        action="store_true",
        help="the turn that is given is right, whatever the record seems to repeat itself by",
    )


def _add_searches(sub: argparse._ActionsContainer) -> None:
    sub.add_argument(
        "--repeats", type=int, default=30, help="searches of method paper (default: 30)"
    )
    sub.add_argument("--seed", type=int, default=1, help="of the first search (default: 1)")


def _add_measuring(sub: argparse.ArgumentParser) -> None:
    group = sub.add_argument_group(
        "measuring",
        "By the torque, under any drive: with --inertia-ratio and --gravity, or --gear-ratio, --motor-inertia, "
        "--load-mass and --load-arm; strokes to and fro need --gear-ratio. The backlash is proportional to the "
        "gravity (twice it, twice the backlash) and hardly depends on the inertia ratio (30 percent off: up to 10). "
        "Else by the speed alone.",
    )
    group.add_argument(
        "--torque", metavar="COLUMN", help="or current; positive if it drives forward"
    )
    for option, name, metavar, usual, text in (
        ("--gravity", "gravity_per_s2", "PER_S2", None, "m g r/J_l; 9.81/r of a point at r [m]"),
        ("--inertia-ratio", "inertia_ratio", "RHO", None, "J_l/(N^2 J_m), load over motor"),
        ("--load-mass", "load_mass_kg", "KG", None, "m, of all that the joint moves"),
        ("--load-arm", "load_arm_m", "M", None, "r, from the axis to its centre of mass"),
        (
            "--load-inertia",
            "load_inertia_kgm2",
            "KGM2",
            None,
            "J_l, about the joint's axis (default: m r^2, a point's)",
        ),
        (
            "--motor-inertia",
            "motor_inertia_kgm2",
            "KGM2",
            None,
            "J_m, to check the torque's unit, too",
        ),
        ("--gravity-sd", "gravity_sd", "SHARE", 0.05, "relative SD of --gravity (default: 0.05)"),
        (
            "--inertia-sd",
            "inertia_sd",
            "SHARE",
            0.1,
            "relative SD of --inertia-ratio (default: 0.1)",
        ),
    ):
        group.add_argument(option, dest=name, type=float, metavar=metavar, default=usual, help=text)
    group.add_argument(
        "--calibration", type=Path, metavar="FILE", help="of your joint, for any drive"
    )
    group.add_argument(
        "--method",
        choices=SENSOR_METHODS,
        help="default: torque with --torque, the calibration's, else self: for the paper's kind of drive only",
    )
    _add_searches(group)
    group.add_argument(
        "--jobs", type=int, default=-1, help="processes for many logs (default: -1, all cores)"
    )
