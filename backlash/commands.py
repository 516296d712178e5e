"""The virtual sensor's commands: `estimate`, `calibrate` and `trend`."""

import argparse
import json
import os
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from backlash import fleet, interface, plant
from backlash.answers import Estimate
from backlash.calibration import read_calibration
from backlash.endings import UNWRITABLE, ends_on_interrupt
from backlash.examine import examine
from backlash.reading.columns import SAID, numbers
from backlash.reading.sources import STDIN, naming
from backlash.refusals import Refusal, library
from backlash.settings import MEASURING, Settings
from replication import compiling
from replication.files import write_bytes, write_csv, write_text

_FAIL_ON = re.compile(r"(cannot-tell|no-backlash)|backlash( *> *(\d*\.?\d+) *(m?)rad)?")
_FAILED = 3  # exit status
_OURS = (
    b"total_play_high_rad",
    b'"uncertainty_rad"',
)  # stand near the start or the end of what --out writes
_ENDS = 2**16
_FIGURES = (".png", ".svg", ".pdf")


def _words(options: argparse.Namespace) -> dict[str, Any]:
    """What the options say of the logs and of measuring, as `interface` takes it."""
    words = {
        name: value
        for name in (*SAID, *MEASURING)
        if (value := getattr(options, name, None)) is not None
    }
    if "calibration" in words:
        words["calibration"] = read_calibration(words["calibration"])
    return words


def _begin(options: argparse.Namespace, logs: Sequence[Path]) -> None:
    """Refuse an output that would overwrite an input; say that the first command on a machine takes long."""
    given = (
        *logs,
        *(vars(options).get(name) for name in ("batch", "calibration", "table", "dates")),
    )
    inputs = {os.path.realpath(path) for path in given if path}
    for option in ("out", "plot", "plots"):
        output = getattr(options, option, None)
        if output and os.path.realpath(output) in inputs:
            raise Refusal(f"--{option} {output}: that is one of the inputs; name another file")
    if compiling.is_empty():
        what = "the first command on this machine may compile, some ten seconds"
        print(what, file=sys.stderr, flush=True)


def _check_output(path: Path | None, endings: Sequence[str], option: str) -> None:
    """Refuse an output that could not be written, before the work is done."""
    if not path:
        return
    if path.suffix.lower() not in endings:
        raise Refusal(f"{option} {path}: its name must end in {' or '.join(endings)}")
    if path.is_dir() or not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise Refusal(
            f"{option} {path}: cannot be written there; name a file in a folder that you may write to"
        )
    if option == "--out" and path.exists() and not _is_ours(path):
        raise Refusal(f"--out {path}: that file is not of this command; name another, or remove it")
    if path.suffix.lower() == ".parquet":
        library("pyarrow", "parquet")
    if option == "--plot":
        library("matplotlib", "plot")


def _is_ours(path: Path) -> bool:
    """Whether a file is a table or a calibration that --out wrote."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        ends = file.read(_ENDS)
        file.seek(max(path.stat().st_size - _ENDS, 0))
        ends += file.read(_ENDS)
    return any(mark in ends for mark in _OURS)


def _print_answer(as_json: bool, content: object, text: str) -> None:
    print(json.dumps(content, indent=1, allow_nan=False) if as_json else text)


def run_estimate(options: argparse.Namespace) -> int:
    """Print or write what logs tell of their backlash."""
    _check_output(options.plot, _FIGURES, "--plot")
    _check_output(options.out, (".csv", ".parquet"), "--out")
    failures = _failures(options.fail_on)
    if bool(options.log) == bool(options.batch):
        raise Refusal("give logs, or --batch with a table of them")
    earlier = options.out if options.out and options.out.exists() else None
    batch = plant.read_batch(
        options.batch or fleet.find_logs(options.log, earlier), _words(options)
    )
    logs = batch.logs
    if Path(STDIN) in logs and (len(logs) > 1 or options.out):
        raise Refusal("- (the standard input) goes alone, and without --out")
    if options.plot and len(logs) > 1:
        raise Refusal(f"--plot: {len(logs)} logs; it shows one, --plots FOLDER each")
    _begin(options, logs)
    if options.plots:
        library("matplotlib", "plot")
        options.plots.mkdir(exist_ok=True)
    if len(logs) == 1 and not (options.out or options.plots) and batch.keys.columns.empty:
        answers = [_estimate_one(logs[0], batch.settings[0], options)]
    else:
        answers = _estimate_many(batch, options)
    is_met = any(
        answer.verdict == verdict and (answer.backlash_rad or 0.0) > limit_rad
        for answer in answers
        for verdict, limit_rad in failures
    )
    return _FAILED if is_met else 0


def _failures(text: str | None) -> list[tuple[str, float]]:
    """Verdicts of --fail-on, each with the backlash [rad] above which it counts."""
    found = []
    for term in text.split(",") if text is not None else ():
        match = _FAIL_ON.fullmatch(term.strip())
        if not match:
            raise Refusal(
                f"--fail-on {term!r}: give cannot-tell, no-backlash, backlash or backlash>0.5mrad"
            )
        verdict = (match[1] or "backlash").replace("-", " ")
        found.append((verdict, float(match[3] or -1) * (1e-3 if match[4] else 1.0)))
    return found


def _estimate_one(log: Path, settings: Settings | Refusal, options: argparse.Namespace) -> Estimate:
    for_programs = options.json or options.jsonl
    if for_programs:
        examined = fleet.examine_or_refuse(log, settings)
    elif isinstance(settings, Refusal):
        raise settings
    else:
        examined = examine(log, settings)
    answer = examined.estimate
    if options.plot and not fleet.plot(examined, options.plot):
        print(f"--plot: not written, there is no fit to show ({answer.verdict})", file=sys.stderr)
    if options.jsonl:
        _print_line(answer.to_dict())
    else:
        _print_answer(options.json, [answer.to_dict()], str(answer))
    if why := fleet.unusable(answer):
        raise Refusal(why)
    return answer


def _print_line(content: dict[str, object]) -> None:
    print(json.dumps(content, allow_nan=False), flush=True)


def _estimate_many(batch: plant.Batch, options: argparse.Namespace) -> list[Estimate]:
    kept = options.out.with_name(f"{options.out.name}.kept") if options.out else None
    found: dict[int, Estimate] = {}
    keys = batch.keys.astype("string").fillna("").to_dict("records")
    try:
        with ends_on_interrupt(f"; the same command goes on from {kept}" if kept else ""):
            each = fleet.run_fleet(batch.logs, batch.settings, options.jobs, kept, options.plots)
            for number, answer in each:
                found[number] = answer
                if options.jsonl:
                    _print_line(keys[number] | answer.to_dict())
        answers = [found[number] for number in sorted(found)]
        bad = [why for answer in answers if (why := fleet.unusable(answer))]
        if options.out and len(bad) < len(found):
            table = batch.keys.join(fleet.as_table(answers))
            if options.out.suffix.lower() == ".parquet":
                write_bytes(options.out, table.to_parquet(index=False))
            else:
                write_csv(options.out, table)
    except OSError as error:
        if not found or error.errno not in UNWRITABLE:
            raise
        _print_all(keys, found)
        what = f"{error.strerror}: {len(found)} of {len(batch.logs)} answers are printed instead"
        raise OSError(error.errno, what) from error
    if kept:
        kept.unlink(missing_ok=True)
    if options.json:
        _print_all(keys, found)
    if len(bad) == len(answers):
        raise Refusal(f"none of {len(bad)} logs is usable; the first: {bad[0]}")
    if bad:
        print(
            f"{len(bad)} of {len(answers)} logs are not usable; their rows say why", file=sys.stderr
        )
    if not (options.json or options.jsonl or options.out):
        print(*answers, sep="\n")
    return answers


def _print_all(keys: Sequence[dict], found: Mapping[int, Estimate]) -> None:
    """Print answers as JSON, with their joints and dates."""
    _print_answer(True, [keys[k] | found[k].to_dict() for k in sorted(found)], "")
    sys.stdout.flush()


def run_calibrate(options: argparse.Namespace) -> int:
    """Make a calibration file."""
    _check_output(options.out, (".json",), "--out")
    words = _words(options)
    interface.settings_of(None, words)  # refuses what cannot be
    logs, table = plant.listed_logs(options.table, "log", "backlash_rad")
    with naming(str(options.table)):
        known_rad = numbers(table, "backlash_rad").tolist()
    _begin(options, logs)
    made = interface.calibrate(logs, known_rad, **words)
    write_text(options.out, made.to_json())
    low, high, spread = (1e3 * part for part in (*made.range_rad, made.uncertainty_rad))
    print(
        f"{options.out}: method {made.method}, {low:.3f} to {high:.3f} mrad, "
        f"uncertainty {spread:.4f} mrad (RMS error at levels left out)"
    )
    return 0


def run_trend(options: argparse.Namespace) -> int:
    """Print how the backlash grows."""
    _check_output(options.plot, _FIGURES, "--plot")
    logs = fleet.find_logs(options.log)
    words = _words(options) | {"relative": options.relative, "jobs": options.jobs}
    _begin(options, logs)
    found = interface.trend(logs, options.dates, limit_rad=options.limit, **words)
    if options.plot:
        from backlash import plots

        plots.save_figure(plots.trend_figure(found), options.plot)
    _print_answer(options.json, found.to_dict(), str(found))
    return 0
