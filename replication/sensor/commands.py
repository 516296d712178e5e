"""The virtual sensor's commands: `estimate`, `calibrate` and `trend`."""

import argparse
import hashlib
import io
import json
import os
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from replication.datasets import Recording
from replication.methods.calibration import Calibration, calibrate
from replication.sensor import fleet, trend
from replication.sensor.columns import LogFormat
from replication.sensor.prepare import CannotTell
from replication.sensor.tables import UnusableLog
from replication.sensor.verdict import SELF, Settings, as_row, as_text, examine, prepared, settings_for

_LARGEST_SMALL_FILE = 2**24  # of a calibration or a list of logs


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
        return Calibration.from_json(_small_text(path), str(path))
    except ValueError as error:
        raise UnusableLog(str(error)) from error


def _small_text(path: Path) -> str:
    try:
        if path.stat().st_size > _LARGEST_SMALL_FILE:
            raise UnusableLog(f"{path}: larger than {_LARGEST_SMALL_FILE // 2**20} MiB; is it the right file?")
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise UnusableLog(f"{path}: cannot be read ({error.strerror}); check the name") from error
    except UnicodeDecodeError as error:
        raise UnusableLog(f"{path}: no text; is it the right file?") from error


def _check_output(path: Path | None, endings: Sequence[str], option: str) -> None:
    """Refuse an output that could not be written, before the work is done."""
    if path is None:
        return
    if path.suffix.lower() not in endings:
        raise UnusableLog(f"{option} {path}: its name must end in {' or '.join(endings)}")
    if path.is_dir() or not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise UnusableLog(f"{option} {path}: cannot be written there; name a file in a folder that you may write to")
    if path.suffix.lower() == ".parquet":
        try:
            import pyarrow  # noqa: F401
        except ImportError as error:
            raise UnusableLog(f"{option} {path}: Parquet needs pyarrow; name a .csv instead") from error


def _write_figure(figure_of: str, path: Path, *shown) -> None:
    """Write a figure of `plots` whole or not at all, the same bytes each time."""
    from matplotlib import pyplot as plt

    from replication.sensor import plots
    from replication.workbook import files

    figure, content, kind = getattr(plots, figure_of)(*shown), io.BytesIO(), path.suffix[1:].lower()
    stamp = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[kind]
    with plt.rc_context({"svg.hashsalt": "backlash"}):
        figure.savefig(content, format=kind, dpi=150, metadata=stamp)
    files.write_bytes(path, content.getvalue())
    plt.close(figure)


def _write_table(table: pd.DataFrame, path: Path) -> None:
    from replication.workbook import files

    if path.suffix.lower() == ".csv":
        files.write_csv(path, table)
    else:
        files.write_bytes(path, table.to_parquet(index=False))


def _print_json(content: object) -> None:
    print(json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False))


# ---------------------------------------------------------------------------------------------------------------


def run_estimate(options: argparse.Namespace) -> int:
    """Print or write what logs tell of their backlash."""
    _check_output(options.plot, (".png", ".svg", ".pdf"), "--plot")
    _check_output(options.out, (".csv", ".parquet"), "--out")
    logs = fleet.find_logs(options.log)
    if options.plot and len(logs) > 1:
        raise UnusableLog(f"--plot: {len(logs)} logs; it shows one")
    settings = _settings(options)
    if len(logs) == 1 and not options.out and not options.dask:
        return _estimate_one(logs[0], settings, options)
    kept = options.out.with_name(f"{options.out.name}.kept") if options.out else None
    try:
        rows = fleet.run_fleet(logs, settings, options.jobs, kept, options.dask)
    except KeyboardInterrupt:
        print("interrupted" + (f"; the same command goes on from {kept}" if kept else ""), file=sys.stderr)
        return 1
    bad = [row for row in rows if row["warnings"] and row["warnings"][0].startswith(fleet.UNUSABLE)]
    if len(bad) == len(rows):
        if kept:
            shutil.rmtree(kept, ignore_errors=True)
        why = bad[0]["warnings"][0].removeprefix(fleet.UNUSABLE)
        raise UnusableLog(why if len(bad) == 1 else f"none of {len(bad)} logs is usable; the first: {why}")
    if bad:
        print(f"{len(bad)} of {len(rows)} logs are not usable; their rows say why", file=sys.stderr)
    if options.json:
        _print_json(rows)
    elif not options.out:
        print("\n".join(as_text(fleet.from_row(row)) for row in rows))
    if options.out:
        _write_table(fleet.as_table(rows), options.out)
        shutil.rmtree(kept, ignore_errors=True)
    return 0


def _estimate_one(log: Path, settings: Settings, options: argparse.Namespace) -> int:
    examined = examine(log, settings)
    text = as_text(examined.estimate)
    if options.plot:
        if examined.model_rps is None:
            print(f"--plot: not written, there is no fit to show ({examined.estimate.verdict})", file=sys.stderr)
        else:
            title = text.splitlines()[0].removeprefix(str(log)).lstrip(": ")
            _write_figure("estimate_figure", options.plot, examined.recording, examined.model_rps, title)
    if options.json:
        _print_json([as_row(examined.estimate)])
    else:
        print(text)
    return 0


def run_calibrate(options: argparse.Namespace) -> int:
    """Make a calibration file."""
    from replication.workbook import files

    _check_output(options.out, (".json",), "--out")
    form = _form(options)
    if options.repeats < 1 or options.seed < 1:
        raise UnusableLog("--repeats and --seed must be 1 or more")
    logs, known = _calibration_table(options.table)
    recordings = [_calibration_record(log, form, options.seed) for log in logs]
    digest = hashlib.sha256(b"".join(log.read_bytes() for log in logs)).hexdigest()
    provenance = f"{len(logs)} logs of {options.table.name}, SHA-256 one after another {digest}"
    try:
        made = calibrate(recordings, known, options.method, provenance, options.repeats, options.seed)
    except ValueError as error:
        raise UnusableLog(f"{options.table}: {error}") from error
    files.write_text(options.out, made.to_json())
    low, high = (1e3 * end for end in made.range_rad)
    print(
        f"{options.out}: method {made.method}, {low:.3f} to {high:.3f} mrad, "
        f"uncertainty {1e3 * made.uncertainty_rad:.4f} mrad (RMS error at levels left out)"
    )
    return 0


def _calibration_table(path: Path) -> tuple[list[Path], list[float]]:
    """Logs and their backlashes [rad]; names are relative to the table's folder."""
    try:
        _small_text(path)
        table = pd.read_csv(path, dtype={"log": str})
        known = pd.to_numeric(table["backlash_rad"]).to_numpy(dtype=float).tolist()
        return [path.parent / name for name in table["log"].str.strip()], known
    except UnusableLog:
        raise
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UnusableLog(f"{path}: no table with the columns log and backlash_rad ({error})") from error


def _calibration_record(log: Path, form: LogFormat, seed: int) -> Recording:
    try:
        return prepared(log, form, seed, [])[0]
    except CannotTell as refusal:
        raise UnusableLog(f"{log}: no use for a calibration: {refusal}") from refusal


def run_trend(options: argparse.Namespace) -> int:
    """Print how the backlash grows."""
    _check_output(options.plot, (".png", ".svg", ".pdf"), "--plot")
    logs = fleet.find_logs(options.log)
    dates = trend.dates_of(logs, options.dates)
    settings = _settings(options)
    rows = fleet.run_fleet(logs, settings, options.jobs, None, options.dask)
    for row in rows:
        if row["verdict"] == "cannot tell":
            print(f"{row['file']}: {row['warnings'][0]}", file=sys.stderr)
    if settings.calibration.method == SELF:
        rows = fleet.with_shared_joint(logs, rows, settings)
    found = trend.fit_trend(rows, list(dates.values()), options.limit)
    if options.plot:
        _write_figure("trend_figure", options.plot, found)
    if options.json:
        _print_json(trend.as_object(found))
    else:
        print(trend.as_text(found))
    return 0
