"""What the workbook's commands do: run, collect, lab, data."""

import argparse
import sys

import workbook
from replication.authors import WORKBOOK_FILES, authors_file
from workbook import provenance
from workbook.checkout import notebook_files
from workbook.report.commands import results_folder


def run_run(options: argparse.Namespace) -> int:
    """Execute notebooks."""
    from workbook import running

    known = notebook_files("py")
    sources = [known.get(path.name, path) for path in options.notebook or known.values()]
    if missing := [str(path) for path in sources if path.suffix != ".py" or not path.is_file()]:
        print(f"{missing[0]}: give a notebook's .py source, such as notebooks/08_noise_table2.py", file=sys.stderr)
        return 2
    destination = workbook.QUICK if options.quick else workbook.ROOT
    limits = {"stall_s": 60 * options.stall_minutes, "watched": options.watch}
    try:
        endings = running.run_notebooks(sources, destination, options.quick, options.stamps, **limits)
    except KeyboardInterrupt:
        print("interrupted; what was finished is kept", file=sys.stderr)
        return 130
    if not options.quick:
        running.note_run(endings)
    return int(any(ending.how == "failed" for ending in endings))


def run_collect(options: argparse.Namespace) -> int:
    """Collect the outcomes of a run."""
    provenance.collect(results_folder(options.quick))
    return 0


def run_lab(_: argparse.Namespace) -> int:
    """Copy the notebooks for JupyterLab."""
    from workbook.lab import LAB, copy_notebooks

    for copy in copy_notebooks():
        print(f"{copy.relative_to(LAB.parent)} is unchanged; delete it to get a new copy")
    return 0


def run_data(_: argparse.Namespace) -> int:
    """Fetch and verify the authors' files."""
    print(*(authors_file(path) for path in WORKBOOK_FILES), sep="\n")
    return 0
