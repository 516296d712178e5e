"""The virtual sensor's command `estimate`."""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from backlash.answer import BACKLASH, CANNOT_TELL, NONE, Estimate
from backlash.batch import KEYS, as_table, find_logs, read_batch, run_batch
from backlash.cli.options import Exit
from backlash.estimates import GIVEN
from backlash.reading.sources import STDIN
from backlash.refusals import Refusal, library
from backlash.torque.unknowns import TABLE
from replication.files import write_bytes, write_csv

_FIGURES = (".png", ".svg", ".pdf")


def _check_output(path: Path | None, endings: Sequence[str], *inputs: Path | None) -> None:
    """Refuse an output that could not be written, or would overwrite an input, before the work is done."""
    if not path:
        return
    problem = ""
    if os.path.realpath(path) in {os.path.realpath(name) for name in inputs if name}:
        problem = "that is one of the inputs; name another file"
    elif path.suffix.lower() not in endings:
        problem = f"its name must end in {' or '.join(endings)}"
    elif path.is_dir() or not os.access(path.parent, os.W_OK):
        problem = "cannot be written there; name a file in a folder that you may write to"
    elif endings is not _FIGURES and path.exists() and not _is_ours(path):
        problem = "that file is not what this command writes; name another, or remove it"
    if problem:
        raise Refusal(f"{path}: {problem}")
    if path.suffix.lower() == ".parquet":
        library("pyarrow", "parquet")
    if endings is _FIGURES:
        library("matplotlib", "plot")


def _is_ours(path: Path) -> bool:
    """Whether a file is a table that --out wrote, to which nothing was added, by its columns and verdicts."""
    read = pd.read_parquet if path.suffix.lower() == ".parquet" else pd.read_csv
    try:
        table = read(path)
    except Exception:  # of whatever stands there
        return False
    joint = {each.printed: (0.0, 0.0) for each in TABLE if each.printed}
    ours = as_table([Estimate("", joint=joint)], pd.DataFrame(columns=KEYS, index=[0]))
    is_ours = {"verdict", "version"} <= {*table} <= {*ours}
    return is_ours and bool(table["verdict"].isin((BACKLASH, NONE, CANNOT_TELL)).all())


def run(options: argparse.Namespace) -> int:
    """Print or write what logs tell of their backlash; returns the exit status."""
    inputs = (*options.log, options.batch)
    if options.out:  # what a link stands for
        options.out = Path(os.path.realpath(options.out))
    _check_output(options.plot, _FIGURES, *inputs)
    _check_output(options.out, (".csv", ".parquet"), *inputs)
    if bool(options.log) == bool(options.batch):
        raise Refusal("give logs, or --batch with a table of them")
    source = options.batch or find_logs(options.log, options.out)
    given = {name: value for name, value in vars(options).items() if name in GIVEN}
    logs = read_batch(source, given)
    count = len(logs)
    if Path(STDIN) in [*logs["file"]] and (count > 1 or options.out):
        raise Refusal("- (the standard input) goes alone, and without --out")
    if options.plot and count > 1:
        raise Refusal(f"--plot: {count} logs; it shows one, --plots FOLDER each")
    if options.plots:
        library("matplotlib", "plot")
        options.plots.mkdir(exist_ok=True)
    journal = options.out.with_name(f"{options.out.name}.kept") if options.out else None
    figures = options.plots or options.plot
    # A defect on one log alone is told as one of the program.
    held = Exception if count > 1 or options.json or options.jsonl or options.out else Refusal
    each = run_batch(logs, given, options.jobs, journal, figures, held)
    # "joint" holds the joint's quantities.
    named = logs.filter(KEYS).rename(columns={"joint": "joint_name"}).astype("string").fillna("")
    objects = named.to_dict("records")
    by_number: dict[int, Estimate] = {}
    for number, answer in each:
        by_number[number] = answer
        objects[number] |= answer.to_dict()
        if options.jsonl:
            print(json.dumps(objects[number], allow_nan=False), flush=True)
    answers = [by_number[number] for number in range(count)]
    bad = [answer for answer in answers if answer.is_unusable]
    if options.out and len(bad) < count:
        table = as_table(answers, logs)
        if options.out.suffix.lower() == ".parquet":
            write_bytes(options.out, table.to_parquet(index=False))
        else:
            write_csv(options.out, table)
    if journal:
        journal.unlink(missing_ok=True)
    if options.json:
        print(json.dumps(objects, indent=1, allow_nan=False))
    if len(bad) == count:
        which = "" if count == 1 else f"none of {count} logs is usable; the first: "
        raise Refusal(which + bad[0].explanation)
    if bad:
        print(f"{len(bad)} of {count} logs are not usable; their rows say why", file=sys.stderr)
    if options.plot and answers[0].amplitude_rps is None and answers[0].chi_squared is None:
        why = f"there is no fit to show ({answers[0].verdict})"
        print(f"--plot: not written, {why}", file=sys.stderr)
    if not (options.json or options.jsonl or options.out):
        print(*answers, sep="\n")
    return Exit.DONE
