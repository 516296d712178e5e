"""The command line's options, in groups, the recommended way first."""

import argparse
from enum import IntEnum
from functools import partial
from pathlib import Path

from backlash import __version__
from backlash.example import EXAMPLE_OPTIONS
from backlash.refusals import one_line, option_of, unit_of

_ABOUT = (
    "Backlash, half of the total play, of a robot's joint from logs of the motor's encoder and torque. The joint "
    "turns round, four turns or more in one direction (twelve are good), or, with end stops, moves to and fro through"
    " the position in which its load hangs down, 60 to 90 degrees to either side at 1 to 2 rad/s, 8 to 12 strokes: at"
    " constant speed, about a horizontal axis, with an off-centre load whose gravity is above its friction. All other"
    " axes are held still, base and arm are stiff beside the payload, the gear is warm. Strokes tell the backlash at "
    "the hanging position. Its errors are known from simulated joints alone, with turns of 0.5 to 2.5 s; slower ones "
    "tell less."
)
_STATUS = (
    "Exit status: 0 done, also where it cannot tell, 1 a defect, 2 unusable input, 130 interrupted."
)
_EXAMPLE = (
    "A log has columns of time, of the motor's speed or position, and of its torque or current, 250 samples a second "
    f"or more. Try it: backlash example; backlash estimate example.csv {EXAMPLE_OPTIONS} . The answer is one of "
    "three: a backlash in mrad at the joint, of which the whole play is twice as much, with its 95 % interval; no "
    "backlash, with the value that it is less than; or why it cannot tell."
)
_WRONG = (
    'What can go wrong is told by "cannot tell" and its reason: "not constant speed", fewer than three strokes each '
    'way at one speed, or an override that changes; "no gravity in the torque", a vertical axis, a balanced load, a '
    'torque of the wrong sign or motor; "no load reversal seen", friction and losses above gravity, which keep the '
    'teeth on one flank; "wrong period", another gear ratio; "turns differ", another axis moves; "no joint fits", '
    "wrong load data, an arm whose own resonance, 6 to 15 Hz, shows in the torque (as in most logs of wrists), a "
    'belt, an error of the gear, a torque logged late; "too noisy", "two backlashes fit", too few turns or samples. '
    "Often not seen are wrong load data that fit nevertheless, and an error of the gear that is sampled too slowly: "
    "compare what is printed of stiffness, efficiency and friction with the data sheet. Without a torque the answer is "
    '"no torque", with the paper\'s index A: compare it only with logs of the same joint in the same movement. '
)
_TORQUE = (
    "--torque with --gear-ratio, --motor-inertia, --load-mass and --load-arm, or with --inertia-ratio and --gravity. "
    "Torque or current as the drive measures it: a low-pass of some ms is found, a running mean of four samples or "
    "more is refused. An error of the gravity is one of the backlash: give both as well as they are known, with their "
    "SDs, which enter the interval."
)
_SIDES = (
    "Speed, position and torque are the motor's, the backlash is the joint's. Of a log with the joint's side, as most "
    "robots write it: --gear-ratio 1 with --inertia-ratio and --gravity; for such a log the answer "
    'is never "no backlash".'
)
_COLUMNS = (
    "By name, or by number in the file, from 1; else the motor's measured ones are found by name, and what may be two "
    "things is asked for. Every answer names them, with their units."
)


class Exit(IntEnum):
    """Exit statuses, as the help says them; 130 is that of shells."""

    DONE = 0
    DEFECT = 1
    UNUSABLE = 2
    INTERRUPTED = 130


class _OneLineParser(argparse.ArgumentParser):
    def error(self, message: str):
        """Say in one line what is wrong with the arguments, and exit."""
        self.exit(Exit.UNUSABLE, one_line(f"{self.prog}: {message}; see --help") + "\n")


def _path(text: str) -> Path:
    """A path; an empty one would be the folder that one is in."""
    if not text.strip():
        raise argparse.ArgumentTypeError("an empty name of a file")
    return Path(text)


def parser() -> argparse.ArgumentParser:
    """The command `estimate`."""
    whole: argparse.ArgumentParser = _OneLineParser(
        prog="backlash", description=_ABOUT, epilog=_STATUS
    )
    whole.add_argument("--version", action="version", version=__version__)
    commands = whole.add_subparsers(required=True, dest="command", metavar="COMMAND")
    estimate = commands.add_parser(
        "estimate",
        help="backlash (half of the play) from logs of the motor encoder and torque",
        description=f"{_ABOUT} {_EXAMPLE}",
        epilog=_WRONG + _STATUS,
    )
    for add in (_add_answers, _add_torque, _add_movement, _add_columns):
        add(estimate)
    commands.add_parser("example", help="write example.csv, a log of a simulated joint, to try")
    return whole


def _add_numbers(group: argparse._ActionsContainer, **what: str) -> None:
    """Options of a number each: keyword of `estimate`, and help."""
    for name, text in what.items():
        unit = unit_of(name) or "n"
        group.add_argument(option_of(name), dest=name, type=float, metavar=unit.upper(), help=text)


def _add_answers(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "log",
        nargs="*",
        type=_path,
        help="CSV, XLSX or Parquet files, or folders of them; - is the standard input",
    )
    group = command.add_argument_group("answers")
    add = group.add_argument
    add(
        "--json", action="store_true", help="print an array with an object for each log, at the end"
    )
    add(
        "--jsonl",
        action="store_true",
        help="print a line with an object for each log, as soon as it is answered",
    )
    add(
        "--out",
        type=_path,
        metavar="TABLE",
        help="write a table, one row per log: .csv or .parquet; interrupted, the same command goes on",
    )
    add(
        "--plot",
        type=_path,
        metavar="FILE",
        help="write a figure of the one log: .png, .svg or .pdf",
    )
    add("--plots", type=_path, metavar="FOLDER", help="write a figure of each log with a fit: .png")
    _add_numbers(group, arm_m="give the whole play in mm at this arm, too")
    add(
        "--batch",
        type=_path,
        metavar="TABLE",
        help="CSV, XLSX or Parquet with the column file, and joint, date, and each log's own turn_period_s, "
        "gear_ratio, torque, inertia_ratio, gravity_per_s2 (or motor_inertia_kgm2, load_mass_kg, load_arm_m, "
        "load_inertia_kgm2), "
        "...; other columns are not read",
    )
    add("--jobs", type=int, default=-1, help="processes (default: all cores)")


def _add_torque(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("the torque and the load", _TORQUE)
    group.add_argument(
        "--torque",
        metavar="COLUMN",
        help="or current, in any unit; positive where it drives along the speed",
    )
    _add_numbers(
        group,
        motor_inertia_kgm2="J_m; the answer then prints the torque's unit in N m",
        load_mass_kg="m, of all that the joint moves",
        load_arm_m="r, from the axis to its centre of mass",
        load_inertia_kgm2="J_l, about the axis (default: m r^2)",
        inertia_ratio="J_l/(N^2 J_m), load over motor, N the gear's",
        gravity_per_s2="m g r/J_l; 9.81/r of a point at r [m]",
        inertia_sd="relative SD of the inertia ratio (0.1)",
        gravity_sd="relative SD of the gravity (0.05)",
    )


def _add_movement(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("the movement", _SIDES)
    _add_numbers(
        group,
        gear_ratio="motor turns in a load turn; 1 for the joint's side",
        turn_period_s="of the load, in place of the gear ratio, or too",
        commanded_speed_rps="of the motor: checks the unit, and tells which of several speeds is meant",
        ring_hz="of the oscillation after an impact (21); below 4 times as many samples a second a log is refused",
    )
    add = partial(group.add_argument, type=float, metavar="S")
    add("--from", dest="start_s", help="leave out what is before [s from the first sample]")
    add("--to", dest="end_s", help="leave out what is after")
    group.add_argument(
        "--trust-period",
        action="store_true",
        help="take the turn that is given even if the record seems to repeat itself by another",
    )


def _add_columns(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("the log's columns", _COLUMNS)
    add = group.add_argument
    add("--time", metavar="COLUMN", help="stamps")
    add("--time-unit", metavar="UNIT", help="of the time stamps: s, ms, us, ns, 100ns, min, h, d")
    _add_numbers(group, rate_hz="without stamps, or where they are to be ignored: samples a second")
    add("--speed", metavar="COLUMN", help="of the motor, or the joint (--gear-ratio 1)")
    add("--position", metavar="COLUMN", help="instead of the speed")
    add(
        "--unit",
        help="of the speed: rps, rpm, rad/s, deg/s, counts (a second); of a position: turns, rad, deg, counts",
    )
    _add_numbers(group, counts_per_turn="encoder counts of a motor turn")
