"""What the workbook's commands do: run, collect, data."""

import argparse
import sys

from replication import workbook
from replication.data.authors import WORKBOOK_FILES, authors_file
from replication.report.commands import results_folder
from replication.workbook import provenance


def run_run(options: argparse.Namespace) -> int:
    """Execute notebooks."""
    from replication.workbook import running  # takes a second and a half, which no other command should wait for

    sources = options.notebook or sorted((workbook.ROOT / "notebooks").glob("[0-9]*.py"))
    try:
        endings = running.run(sources, options.quick, options.stamps, 60 * options.stall_minutes, options.watch)
    except KeyboardInterrupt:
        print("interrupted; what was finished is kept", file=sys.stderr)
        return 130
    failed = [ending.why for ending in endings if ending.how == "failed"]
    if not options.quick:
        running.note_run(endings)
    print("\n".join([running.slowest_cells(endings), *(f"failed: {why}" for why in failed)]), file=sys.stderr)
    return 1 if failed else 0


def run_collect(options: argparse.Namespace) -> int:
    """Collect the outcomes of a run."""
    provenance.collect(results_folder(options.quick))
    return 0


def run_data(_: argparse.Namespace) -> int:
    """Fetch and verify the authors' files."""
    for path in WORKBOOK_FILES:
        print(authors_file(path))
    return 0
