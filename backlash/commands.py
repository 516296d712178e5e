"""The virtual sensor's commands: `estimate`, `calibrate` and `trend`."""

import argparse
import json
import os
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from backlash import fleet, interface, plant
from backlash.answers import Estimate
from backlash.calibration import read_calibration
from backlash.examine import examine
from backlash.main import UNWRITABLE, ends_on_interrupt
from backlash.reading.columns import SAID, LogFormat
from backlash.reading.refusals import UnusableLog, library
from backlash.reading.sources import STDIN
from backlash.settings import MEASURING, Settings, settings_for
from backlash.trend_line import Trend
from replication.compiled import cache

_INPUTS = {
    "batch": "the --batch table",
    "calibration": "the calibration",
    "table": "the table of known backlashes",
    "dates": "the table of dates",
}
_FAIL_ON = re.compile(r"cannot-tell|no-backlash|backlash( *> *(\d*\.?\d+) *(m?)rad)?")
_FAILED = 3  # exit status
_FIGURES = (".png", ".svg", ".pdf")


def _said(options: argparse.Namespace) -> dict[str, Any]:
    """What the options say of the logs, by the fields of `LogFormat`."""
    said = {name: getattr(options, name, None) for name in SAID}
    return {name: value for name, value in said.items() if value is not None}


def _how(options: argparse.Namespace) -> dict[str, Any]:
    """How the options say that logs are measured, as `settings_for` and `interface` take it."""
    how = {name: getattr(options, name) for name in MEASURING}
    return how | {"calibration": read_calibration(options.calibration)}


def _announce_compiling() -> None:
    """Say that the first command on a machine takes long."""
    if cache.is_empty():
        print("compiling, once for this machine: some ten seconds", file=sys.stderr, flush=True)


def _check_output(path: Path | None, endings: Sequence[str], option: str) -> None:
    """Refuse an output that could not be written, before the work is done."""
    if path is None:
        return
    if path.suffix.lower() not in endings:
        raise UnusableLog(f"{option} {path}: its name must end in {' or '.join(endings)}")
    if path.is_dir() or not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise UnusableLog(
            f"{option} {path}: cannot be written there; name a file in a folder that you may write to"
        )
    if path.suffix.lower() == ".parquet":
        library("pyarrow", "parquet")
    if option == "--plot":
        library("matplotlib", "plot")


def _keep_inputs(options: argparse.Namespace, logs: Sequence[Path]) -> None:
    """Refuse an output that would overwrite an input."""
    inputs: list[tuple[Path | None, str]] = [(log, "one of the logs") for log in logs]
    inputs += [(getattr(options, name, None), what) for name, what in _INPUTS.items()]
    for option in ("out", "plot"):
        output = getattr(options, option, None)
        for path, what in inputs:
            if output and path and os.path.realpath(output) == os.path.realpath(path):
                raise UnusableLog(f"--{option} {output}: that is {what}; name another file")


def _is_answers(path: Path | None) -> bool:
    """Whether a file is a table that --out wrote."""
    return path is not None and path.is_file() and b"total_play_high_rad" in path.read_bytes()


def _write_figure(path: Path, figure_of: str, *shown) -> None:
    """Write a figure of `plots` whole or not at all."""
    from backlash import plots

    write_bytes(path, plots.content_of(getattr(plots, figure_of)(*shown), path.suffix.lower()))


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_bytes(content)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _print_answer(as_json: bool, content: object, text: str) -> None:
    print(json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) if as_json else text)


def run_estimate(options: argparse.Namespace) -> int:
    """Print or write what logs tell of their backlash."""
    _check_output(options.plot, _FIGURES, "--plot")
    _check_output(options.out, (".csv", ".parquet"), "--out")
    failures = _failures(options.fail_on)
    if bool(options.log) == bool(options.batch):
        raise UnusableLog("give logs, or --batch with a table of them")
    words = _how(options) | _said(options)
    if options.batch:
        batch = plant.read_batch(options.batch, words)
    else:
        found = fleet.find_logs(options.log, options.out if _is_answers(options.out) else None)
        nothing = pd.DataFrame(index=range(len(found)))
        batch = plant.Batch(found, interface.settings_of(found, words), nothing)
    logs = batch.logs
    _keep_inputs(options, logs)
    if Path(STDIN) in logs and (len(logs) > 1 or options.out):
        raise UnusableLog("- (the standard input) goes alone, and without --out")
    if options.plot and len(logs) > 1:
        raise UnusableLog(f"--plot: {len(logs)} logs; it shows one")
    _announce_compiling()
    if len(logs) == 1 and not options.out and batch.keys.columns.empty:
        answers = [_estimate_one(logs[0], batch.settings[0], options)]
    else:
        answers = _estimate_many(batch, options)
    is_met = any(_fails(answer, failure) for answer in answers for failure in failures)
    return _FAILED if is_met else 0


def _fails(answer: Estimate, failure: tuple[str, float]) -> bool:
    """Whether an answer is one that --fail-on names."""
    verdict, limit_rad = failure
    return answer.verdict == verdict and (answer.backlash_rad or 0.0) > limit_rad


def _failures(text: str | None) -> list[tuple[str, float]]:
    """Verdicts of --fail-on, each with the backlash [rad] above which it counts."""
    found = []
    for term in text.split(",") if text is not None else ():
        match = _FAIL_ON.fullmatch(term.strip())
        if match is None:
            raise UnusableLog(
                f"--fail-on {term!r}: give cannot-tell, no-backlash, backlash or backlash>0.5mrad"
            )
        limit = float(match[2]) * (1e-3 if match[3] else 1.0) if match[2] else -1.0
        found.append((term.partition(">")[0].strip().replace("-", " "), limit))
    return found


def _estimate_one(log: Path, settings: Settings, options: argparse.Namespace) -> Estimate:
    examined = fleet.examine_or_refuse(log, settings) if options.json else examine(log, settings)
    answer, fitted = examined.estimate, examined.fitted
    text = str(answer)
    if options.plot and fitted is None:
        print(f"--plot: not written, there is no fit to show ({answer.verdict})", file=sys.stderr)
    elif options.plot and fitted is not None:
        title = text.splitlines()[0].removeprefix(str(log)).lstrip(": ")
        _write_figure(options.plot, "estimate_figure", fitted.recording, fitted.model_rps, title)
    _print_answer(options.json, [answer.to_dict()], text)
    if why := fleet.unusable(answer):
        raise UnusableLog(why)
    return answer


def _estimate_many(batch: plant.Batch, options: argparse.Namespace) -> list[Estimate]:
    kept = options.out.with_name(f"{options.out.name}.kept") if options.out else None
    found: dict[int, Estimate] = {}
    try:
        with (
            ends_on_interrupt(f"; the same command goes on from {kept}" if kept else ""),
            fleet.cluster(options.dask),
        ):
            for number, answer in fleet.run_fleet(batch.logs, batch.settings, options.jobs, kept):
                found[number] = answer
        bad = [why for answer in found.values() if (why := fleet.unusable(answer))]
        if options.out and len(bad) < len(found):
            table = batch.keys.join(fleet.as_table([found[number] for number in sorted(found)]))
            write_bytes(options.out, _table_bytes(table, options.out.suffix.lower()))
    except OSError as error:
        if not found or error.errno not in UNWRITABLE:
            raise
        _print_all(batch, found)
        what = f"{error.strerror}: {len(found)} of {len(batch.logs)} answers are printed instead"
        raise OSError(error.errno, what) from error
    if kept:
        kept.unlink(missing_ok=True)
    answers = [found[number] for number in sorted(found)]
    if len(bad) == len(answers):
        first = fleet.unusable(answers[0])
        raise UnusableLog(
            first if len(bad) == 1 else f"none of {len(bad)} logs is usable; the first: {first}"
        )
    if bad:
        print(
            f"{len(bad)} of {len(answers)} logs are not usable; their rows say why", file=sys.stderr
        )
    if options.json:
        _print_all(batch, found)
    elif not options.out:
        print(*answers, sep="\n")
    return answers


def _print_all(batch: plant.Batch, found: Mapping[int, Estimate]) -> None:
    """Print answers as JSON, with their joints and dates."""
    keys = batch.keys.astype("string").fillna("").to_dict("records")
    _print_answer(True, [keys[k] | found[k].to_dict() for k in sorted(found)], "")
    sys.stdout.flush()


def _table_bytes(table: pd.DataFrame, ending: str) -> bytes:
    """A table as a file of the kind that its ending names."""
    if ending == ".parquet":
        return table.to_parquet(index=False)
    return table.to_csv(index=False, float_format="%.6g", lineterminator="\n").encode()


def run_calibrate(options: argparse.Namespace) -> int:
    """Make a calibration file."""
    _check_output(options.out, (".json",), "--out")
    said = _said(options)
    # Refuses what cannot be.
    settings_for(LogFormat(**said), None, None, options.repeats, options.seed)
    logs, table = plant.listed_logs(options.table, "log", "backlash_rad")
    _keep_inputs(options, logs)
    _announce_compiling()
    how = {"method": options.method, "repeats": options.repeats, "seed": options.seed}
    made = interface.calibrate(logs, table["backlash_rad"].tolist(), **how, **said)
    write_bytes(options.out, made.to_json().encode())
    low, high, spread = (1e3 * part for part in (*made.range_rad, made.uncertainty_rad))
    known_range = f"method {made.method}, {low:.3f} to {high:.3f} mrad"
    print(
        f"{options.out}: {known_range}, uncertainty {spread:.4f} mrad (RMS error at levels left out)"
    )
    return 0


def run_trend(options: argparse.Namespace) -> int:
    """Print how the backlash grows, for tables of answers that of each joint."""
    _check_output(options.plot, _FIGURES, "--plot")
    logs = fleet.find_logs(options.log)
    shown = {"limit_rad": options.limit, "relative": options.relative}
    if _is_answers(logs[0]):
        return _print_trends(logs, options, shown)
    how = _how(options) | _said(options)
    _keep_inputs(options, logs)
    _announce_compiling()
    found = interface.trend(logs, options.dates, jobs=options.jobs, **shown, **how)
    if options.plot:
        _write_figure(options.plot, "trend_figure", found)
    _print_answer(options.json, found.to_dict(), str(found))
    return 0


def _print_trends(
    tables: Sequence[Path], options: argparse.Namespace, shown: Mapping[str, Any]
) -> int:
    if options.plot:
        raise UnusableLog("--plot: it shows the trend of one joint's logs, not tables of answers")
    answers = pd.concat([fleet.read_rows(table, *plant.OF_ANSWERS) for table in tables])
    found = plant.trend_many(answers, **shown)
    rows = [
        {"joint": joint} | (each.to_dict() if isinstance(each, Trend) else {"reason": str(each)})
        for joint, each in found.items()
    ]
    _print_answer(options.json, rows, "\n".join(f"joint {j}: {each}" for j, each in found.items()))
    return 0
