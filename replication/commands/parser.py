"""A parser that says in one line what is wrong, and commands whose code is imported when they run."""

import argparse
from importlib import import_module


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


def run_command(options: argparse.Namespace) -> int:
    """Do what the parsed command says, and return its exit status."""
    return getattr(import_module(options.module), options.function)(options)
