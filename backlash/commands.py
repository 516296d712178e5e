"""The virtual sensor's commands: `estimate`, `calibrate` and `trend`."""

import argparse
import hashlib
import io
import json
import os
import shutil
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import pandas as pd

from backlash import fleet, trend
from backlash.calibration import Calibration, calibrate
from backlash.estimation import Settings, as_row, as_text, examine, prepared_record, settings_for
from backlash.fitting import SELF
from backlash.reading.columns import LogFormat
from backlash.reading.prepare import CannotTell
from backlash.reading.tables import UnusableLog
from replication import files

_FIGURE_STAMPS = {".png": {}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}  # none, for the same bytes


def _form(options: argparse.Namespace) -> LogFormat:
    return LogFormat(
        options.time, options.speed, options.position, options.unit, options.counts_per_turn,
        options.commanded_speed, options.turn_period, options.gear_ratio,
    )  # fmt: skip


def _settings(options: argparse.Namespace) -> Settings:
    form = _form(options)
    calibration = read_calibration(options.calibration) if options.calibration else None
    try:
        return settings_for(form, calibration, options.method, options.repeats, options.seed)
    except ValueError as error:
        raise UnusableLog(str(error)) from error


def read_calibration(path: Path) -> Calibration:
    """Read a calibration file; refuse in one line what is none."""
    try:
        return Calibration.from_json(path.read_text(encoding="utf-8"), str(path))
    except OSError as error:
        raise UnusableLog(f"{path}: cannot be read ({error.strerror}); check the name") from error
    except UnicodeDecodeError as error:
        raise UnusableLog(f"{path}: no text; is it the right file?") from error
    except ValueError as error:
        raise UnusableLog(str(error)) from error


def _check_output(path: Path | None, endings: Sequence[str], option: str) -> None:
    """Refuse an output that could not be written, before the work is done."""
    if path is None:
        return
    if path.suffix.lower() not in endings:
        raise UnusableLog(f"{option} {path}: its name must end in {' or '.join(endings)}")
    if path.is_dir() or not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise UnusableLog(f"{option} {path}: cannot be written there; name a file in a folder that you may write to")
    if path.suffix.lower() == ".parquet" and find_spec("pyarrow") is None:
        raise UnusableLog(f"{option} {path}: Parquet needs pyarrow; name a .csv instead")


def _write_figure(figure_of: str, path: Path, *shown) -> None:
    """Write a figure of `plots` whole or not at all, the same bytes each time."""
    from matplotlib import pyplot as plt

    from backlash import plots

    figure, content, ending = getattr(plots, figure_of)(*shown), io.BytesIO(), path.suffix.lower()
    with plt.rc_context({"svg.hashsalt": "backlash"}):
        figure.savefig(content, format=ending[1:], dpi=150, metadata=_FIGURE_STAMPS[ending])
    files.write_bytes(path, content.getvalue())
    plt.close(figure)


def _print_answer(as_json: bool, content: object, text: str) -> None:
    print(json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) if as_json else text)


def run_estimate(options: argparse.Namespace) -> int:
    """Print or write what logs tell of their backlash."""
    _check_output(options.plot, tuple(_FIGURE_STAMPS), "--plot")
    _check_output(options.out, (".csv", ".parquet"), "--out")
    logs = fleet.find_logs(options.log)
    if options.plot and len(logs) > 1:
        raise UnusableLog(f"--plot: {len(logs)} logs; it shows one")
    settings = _settings(options)
    if len(logs) == 1 and not options.out:
        return _estimate_one(logs[0], settings, options)
    return _estimate_many(logs, settings, options)


def _estimate_one(log: Path, settings: Settings, options: argparse.Namespace) -> int:
    examined = examine(log, settings)
    text = as_text(examined.estimate)
    if options.plot and examined.model_rps is None:
        print(f"--plot: not written, there is no fit to show ({examined.estimate.verdict})", file=sys.stderr)
    elif options.plot:
        title = text.splitlines()[0].removeprefix(str(log)).lstrip(": ")
        _write_figure("estimate_figure", options.plot, examined.recording, examined.model_rps, title)
    _print_answer(options.json, [as_row(examined.estimate)], text)
    return 0


def _estimate_many(logs: Sequence[Path], settings: Settings, options: argparse.Namespace) -> int:
    kept = options.out.with_name(f"{options.out.name}.kept") if options.out else None
    try:
        answers = fleet.run_fleet(logs, settings, options.jobs, kept)
    except KeyboardInterrupt:
        print("interrupted" + (f"; the same command goes on from {kept}" if kept else ""), file=sys.stderr)
        return 1
    bad = [answer.warnings[0] for answer in answers if "".join(answer.warnings[:1]).startswith(fleet.UNUSABLE)]
    if len(bad) < len(answers):
        if bad:
            print(f"{len(bad)} of {len(answers)} logs are not usable; their rows say why", file=sys.stderr)
        if options.json or not options.out:
            _print_answer(options.json, [as_row(answer) for answer in answers], "\n".join(map(as_text, answers)))
        if options.out and options.out.suffix.lower() == ".csv":
            files.write_csv(options.out, fleet.as_table(answers))
        elif options.out:
            files.write_bytes(options.out, fleet.as_table(answers).to_parquet(index=False))
    if kept:
        shutil.rmtree(kept, ignore_errors=True)
    if len(bad) == len(answers):
        why = bad[0].removeprefix(fleet.UNUSABLE)
        raise UnusableLog(why if len(bad) == 1 else f"none of {len(bad)} logs is usable; the first: {why}")
    return 0


def run_calibrate(options: argparse.Namespace) -> int:
    """Make a calibration file."""
    _check_output(options.out, (".json",), "--out")
    form = _form(options)
    if options.repeats < 1 or options.seed < 1:
        raise UnusableLog("--repeats and --seed must be 1 or more")
    logs, known = _calibration_table(options.table)
    recordings = []
    for log in logs:
        try:
            recordings.append(prepared_record(log, form, options.seed))
        except CannotTell as refusal:
            raise UnusableLog(f"{log}: no use for a calibration: {refusal}") from refusal
    digest = hashlib.sha256(b"".join(log.read_bytes() for log in logs)).hexdigest()
    provenance = f"{len(logs)} logs of {options.table.name}, SHA-256 one after another {digest}"
    try:
        made = calibrate(recordings, known, options.method, provenance, options.repeats, options.seed)
    except ValueError as error:
        raise UnusableLog(f"{options.table}: {error}") from error
    files.write_text(options.out, made.to_json())
    low, high, spread = (1e3 * part for part in (*made.range_rad, made.uncertainty_rad))
    known_range = f"method {made.method}, {low:.3f} to {high:.3f} mrad"
    print(f"{options.out}: {known_range}, uncertainty {spread:.4f} mrad (RMS error at levels left out)")
    return 0


def _calibration_table(path: Path) -> tuple[list[Path], list[float]]:
    """Logs and their backlashes [rad]; names are relative to the table's folder."""
    try:
        table = pd.read_csv(path, dtype={"log": str})
        known = pd.to_numeric(table["backlash_rad"]).to_numpy(dtype=float).tolist()
        return [path.parent / name for name in table["log"].str.strip()], known
    except OSError as error:
        raise UnusableLog(f"{path}: cannot be read ({error.strerror}); check the name") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UnusableLog(f"{path}: no table with the columns log and backlash_rad ({error})") from error


def run_trend(options: argparse.Namespace) -> int:
    """Print how the backlash grows."""
    _check_output(options.plot, tuple(_FIGURE_STAMPS), "--plot")
    logs = fleet.find_logs(options.log)
    dates = trend.dates_of(logs, options.dates)
    settings = _settings(options)
    answers = fleet.run_fleet(logs, settings, options.jobs)
    for answer in answers:
        if answer.verdict == "cannot tell":
            print(f"{answer.file}: {answer.warnings[0]}", file=sys.stderr)
    if settings.calibration.method == SELF:
        answers = fleet.with_shared_joint(logs, answers, settings)
    found = trend.fit_trend(answers, list(dates.values()), options.limit)
    if options.plot:
        _write_figure("trend_figure", options.plot, found)
    _print_answer(options.json, trend.as_object(found), trend.as_text(found))
    return 0
