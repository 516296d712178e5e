"""The workbook's command line; the Makefile's targets call it.

What a command needs is imported when it runs: `check` needs no kernel, and `run` no report.
"""

import argparse
import errno
import os
import sys
from pathlib import Path

from replication.files import ROOT
from workbook.checkout import APART, OFFLINE, QUICK, RESULTS, lock, notebook_files, results_folder

# Of an output that takes no more: whoever read a pipe has seen enough, a disk is full, or a checkout read-only.
UNWRITABLE = {errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS, errno.EACCES}


class OneLineParser(argparse.ArgumentParser):
    """A parser that says in one line what is wrong with its arguments."""

    def error(self, message: str):
        """Exit with 2."""
        self.exit(2, f"{self.prog}: {message}; see --help\n")


def main(arguments: list[str] | None = None) -> int:
    """Run one command; return the exit status: 0 done, 2 the input is not usable, 1 anything else."""
    options = _parser().parse_args(arguments)
    try:
        status = options.command(options)
        print(end="", flush=True)
        return status
    except Exception as error:
        if isinstance(error, OSError) and error.errno in UNWRITABLE:
            if error.errno != errno.EPIPE:
                print(f"the output cannot be written: {error}", file=sys.stderr)
            # Nothing is left to be flushed at the end.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        # Of errors whose message is the one line that a user needs.
        if not hasattr(error, "exit_status"):
            raise
        print(error, file=sys.stderr)
        return error.exit_status


def _parser() -> OneLineParser:
    parser = OneLineParser(prog="python -m workbook", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    made = {}
    for command in (run, report, check, verify, diff, lab, data):
        made[command] = commands.add_parser(command.__name__, help=command.__doc__)
        made[command].set_defaults(command=command)
    for command in (run, report, check):
        made[command].add_argument(
            "--quick", action="store_true", help="few repeats; results go to results/quick"
        )
    made[run].add_argument("notebook", nargs="*", type=Path, help="a notebook's .py source")
    made[run].add_argument(
        "--due",
        action="store_true",
        help="leave out what this checkout has run, if no source of it has changed since",
    )
    made[run].add_argument("--watch", type=int, help="end when this process (make) has ended")
    text = "minutes without progress that end a notebook"
    made[run].add_argument("--stall-minutes", type=float, default=15, help=text)
    made[diff].add_argument(
        "--lab", action="store_true", help="compare what was run by hand, in results/lab"
    )
    return parser


def run(options: argparse.Namespace) -> int:
    """Execute notebooks, in order; all if none is named."""
    from workbook.due import due

    sources = options.notebook or [*notebook_files("py").values()]
    if missing := [str(path) for path in sources if path.suffix != ".py" or not path.is_file()]:
        print(
            f"{missing[0]}: give a notebook's .py source, such as notebooks/08_noise_table2.py",
            file=sys.stderr,
        )
        return 2
    destination = QUICK if options.quick else ROOT
    try:
        with lock(destination):
            wanted = due(sources, destination) if options.due else sources
            if not wanted:
                return 0
            from workbook import running

            stall_s = 60 * options.stall_minutes
            endings = running.run_notebooks(
                wanted, destination, options.quick, stall_s, options.watch
            )
    except KeyboardInterrupt:
        print("interrupted; what was finished is kept", file=sys.stderr)
        return 130
    if not options.quick:
        running.note_run(endings)
        if any(ending.how == "simulated" for ending in endings):
            from workbook.report import write_report

            print(write_report(OFFLINE / "results"), APART[OFFLINE], sep=": ", file=sys.stderr)
    return int(any(ending.how == "failed" for ending in endings))


def check(options: argparse.Namespace) -> int:
    """Print every number with its verdict; exit 1 if one differs unexpectedly."""
    from workbook import judging, report

    verdicts = judging.verdicts(results_folder(options.quick))
    new, gone = report.find_surprises(verdicts)
    print("\n".join([report.list_numbers(verdicts), *new, *gone]))
    return int(bool(new))


def report(options: argparse.Namespace) -> int:
    """Write the verdicts, report.md, and the status in README.md."""
    from workbook.report import update_readme, write_report

    results = results_folder(options.quick)
    print(write_report(results))
    if not options.quick:
        update_readme(ROOT / "README.md", results)
    return 0


def verify(_: argparse.Namespace) -> int:
    """Write versions, processor, hashes and verdicts to verification.json, for whoever asks."""
    from workbook.report import write_manifest

    path = ROOT / "verification.json"
    write_manifest(RESULTS, path)
    print(path)
    return 0


def diff(options: argparse.Namespace) -> int:
    """List cells and claims whose value or verdict changed since the last commit."""
    from workbook.changes import committed_table, list_changes

    results = RESULTS / "lab" / "results" if options.lab else RESULTS
    tables = committed_table("verdicts.csv"), committed_table("claims.csv")
    changes = list_changes(results, *tables, repeats=not options.lab)
    print("\n".join(changes) or "nothing changed")
    return 0


def lab(_: argparse.Namespace) -> int:
    """Copy the notebooks to lab/ for changes."""
    from workbook.lab import LAB, copy_notebooks

    for copy in copy_notebooks():
        print(f"{copy.relative_to(LAB.parent)} is unchanged; delete it to get a new copy")
    return 0


def data(_: argparse.Namespace) -> int:
    """Fetch and verify the authors' files."""
    from replication.records import WORKBOOK_FILES, authors_file

    print(*(authors_file(path) for path in WORKBOOK_FILES), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
