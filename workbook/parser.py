"""Command lines: parsers that say in one line what is wrong, and commands whose code is imported when they run."""

import argparse
import errno
import os
import sys
from collections.abc import Container, Sequence
from importlib import import_module

from workbook.checkout import require_checkout

# Of an output that takes no more: whoever read a pipe has seen enough, or a disk is full.
UNWRITABLE = {errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EIO}


class OneLineParser(argparse.ArgumentParser):
    """A parser that says in one line what is wrong with its arguments."""

    def error(self, message: str):
        """Exit with 2."""
        self.exit(2, f"{self.prog}: {message}; see --help\n")


def add_command(commands: argparse._SubParsersAction, name: str, module: str, text: str) -> argparse.ArgumentParser:
    """Add a command that `run_<name>` of a module does with the parsed options."""
    sub = commands.add_parser(name, help=text)
    sub.set_defaults(module=module, function=f"run_{name.replace('-', '_')}")
    return sub


def run_command(parser: argparse.ArgumentParser, arguments: Sequence[str] | None, anywhere: Container[str]) -> int:
    """Do what the arguments say; return the exit status: 0 done, 2 the input is not usable, 1 anything else.

    Commands that are not in `anywhere` need a checkout of the project.
    """
    if sys.stdout is None:
        print("the answer cannot be written (the standard output is closed)", file=sys.stderr)
        return 1
    try:
        try:
            options = parser.parse_args(arguments)
            if options.command_name not in anywhere:
                require_checkout()
            return getattr(import_module(options.module), options.function)(options)
        finally:
            sys.stdout.flush()
    except Exception as error:
        if isinstance(error, OSError) and error.errno in UNWRITABLE:
            if error.errno != errno.EPIPE:
                print(f"the answer cannot be written ({error.strerror})", file=sys.stderr)
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nothing is left to be flushed at the end
            return 1
        if not hasattr(error, "exit_status"):  # of errors whose message is the one line that a user needs
            raise
        print(error, file=sys.stderr)
        return error.exit_status
