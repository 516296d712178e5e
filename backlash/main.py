"""The virtual sensor's command line: `backlash estimate`, `calibrate` and `trend`."""

import argparse
from pathlib import Path

from backlash.fitting import METHODS, SENSOR_METHODS
from backlash.reading import UNITS
from replication.commands.parser import OneLineParser, add_command, run_command

_COMMANDS = "backlash.commands"


def main(arguments: list[str] | None = None) -> int:
    """Run one command of the sensor."""
    parser = OneLineParser(prog="backlash", description="Backlash of a robot's joint from logs of the motor encoder.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command_name")

    sub = add_command(commands, "estimate", _COMMANDS, "backlash from logs of the motor encoder")
    sub.add_argument("log", nargs="+", type=Path, help="CSV, Parquet or XLSX files, or folders of them")
    _add_log_options(sub)
    _add_measuring(sub)
    sub.add_argument("--json", action="store_true", help="print an array with an object for each log")
    sub.add_argument("--plot", type=Path, metavar="FILE", help="write a figure of the one log: .png, .svg or .pdf")
    sub.add_argument("--out", type=Path, metavar="TABLE", help="write a table, one row per log: .csv or .parquet")

    sub = add_command(commands, "calibrate", _COMMANDS, "a calibration from logs of known backlash")
    sub.add_argument("table", type=Path, help="CSV with the columns log (its file) and backlash_rad")
    sub.add_argument("--out", type=Path, required=True, metavar="FILE", help="the calibration, .json")
    sub.add_argument("--method", choices=METHODS, default="waveform", help="default: waveform")
    _add_log_options(sub)
    _add_searches(sub)

    sub = add_command(commands, "trend", _COMMANDS, "growth of the backlash, and when it crosses a limit")
    sub.add_argument("log", nargs="+", type=Path, help="logs or folders; dates in their names, like 2024-03-17")
    sub.add_argument("--dates", type=Path, metavar="TABLE", help="CSV with the columns file and date instead")
    sub.add_argument("--limit", type=float, metavar="RAD", help="the backlash whose date is wanted [rad]")
    _add_log_options(sub)
    _add_measuring(sub)
    sub.add_argument("--json", action="store_true", help="print an object")
    sub.add_argument("--plot", type=Path, metavar="FILE", help="write a figure: .png, .svg or .pdf")
    return run_command(parser, arguments, anywhere=("estimate", "calibrate", "trend"))


def _add_log_options(sub: argparse.ArgumentParser) -> None:
    group = sub.add_argument_group("the logs")
    group.add_argument("--time", metavar="COLUMN", help="by name, or by number from 1; found by name otherwise")
    group.add_argument("--speed", metavar="COLUMN", help="of the motor")
    group.add_argument("--position", metavar="COLUMN", help="of the motor, instead of its speed")
    group.add_argument("--unit", choices=UNITS, help="of the speed; of a position: rps for turns, rad/s for rad")
    group.add_argument("--counts-per-turn", type=float, metavar="N", help="encoder counts of a motor turn")
    group.add_argument("--commanded-speed", type=float, metavar="RPS", help="of the motor [rps], to check the unit by")
    group.add_argument("--turn-period", type=float, metavar="S", help="of the load [s]")
    group.add_argument("--gear-ratio", type=float, metavar="N", help="motor turns in a load turn, instead")


def _add_searches(sub: argparse._ActionsContainer) -> None:
    sub.add_argument("--repeats", type=int, default=30, help="searches of method paper (default: 30)")
    sub.add_argument("--seed", type=int, default=1, help="of the first search (default: 1)")


def _add_measuring(sub: argparse.ArgumentParser) -> None:
    group = sub.add_argument_group("measuring")
    group.add_argument("--calibration", type=Path, metavar="FILE", help="of your joint; default: what the log tells")
    group.add_argument("--method", choices=SENSOR_METHODS, help="default: the calibration's, else self")
    _add_searches(group)
    group.add_argument("--jobs", type=int, default=-1, help="processes for many logs (default: -1, all cores)")
