"""The sensor from Python: `read_log`, `estimate`, `calibrate` and `trend`.

A log is a path (str or Path), a table (DataFrame) whose columns are named as in a file, or what
`read_log` returned. What is said of logs are the fields of `LogFormat`, as on the command line:
`turn_period_s` or `gear_ratio`, one of which is needed, and `time`, `speed`, `position` (columns),
`unit`, `counts_per_turn`, `commanded_speed_rps`, `start_s`, `end_s`, `trust_period`, `torque`. How
they are measured: `calibration`, `method`, `repeats`, `seed`, and with a torque the load's data:
`inertia_ratio` and `gravity_per_s2`, or the parameters of `LoadData.from_masses`, and `inertia_sd`
and `gravity_sd`. A Refusal is a ValueError whose message is one line: what is wrong, where,
what to do.
"""

import hashlib
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import pandas as pd
from numpy.typing import ArrayLike

from backlash import fleet, trend_line
from backlash.answers import Estimate
from backlash.calibration import Calibration, fit_calibration, read_calibration
from backlash.detection.pattern import detect_pattern
from backlash.examine import examine
from backlash.reading.columns import SAID, LogFormat
from backlash.reading.prepare import Log, open_log
from backlash.reading.sources import name_of
from backlash.refusals import Refusal
from backlash.settings import MEASURING, Settings, settings_for
from backlash.trend_line import Trend


def form_of(log: object, said: Mapping[str, Any]) -> LogFormat:
    """What is said of a log; `position=True` says it of arrays, and a log that was read has it all."""
    said = {name: value for name, value in said.items() if name not in MEASURING}
    if unknown := sorted(set(said) - set(SAID)):
        raise TypeError(f"no parameter {unknown[0]!r}; of logs there are {', '.join(SAID)}")
    if isinstance(log, Log):
        if said:
            raise Refusal(f"{log.file} was read already: give {', '.join(said)} to read_log")
        return log.form
    if said.get("position") is True:
        said["position"] = "position"
    if not isinstance(said.get("torque", ""), str | int | None):
        said["torque"] = "torque array"
    return LogFormat(**said)


def settings_of(log: object, words: Mapping[str, Any]) -> Settings:
    """Settings of a log by what is said of it."""
    how = {name: words[name] for name in MEASURING if name in words}
    return settings_for(form_of(log, words), **how)


def settings_of_all(logs: Sequence[object], words: Mapping[str, Any]) -> list[Settings]:
    """Settings of logs of which the same is said."""
    known = {**words, "calibration": read_calibration(words.get("calibration"))}
    return [settings_of(log, known) for log in logs]


def read_log(log: object, v: ArrayLike | None = None, **said: Any) -> Log:
    """Read a log's stretch of constant speed; parameters as in `estimate`.

    Returns
    -------
    Log
        Its `recording` has t [s] and v [rps], each of shape (samples,).

    Raises
    ------
    Refusal
        The file is no usable log, or too short or uneven for any answer.

    Examples
    --------
    >>> import backlash
    >>> log = backlash.read_log("log.csv", gear_ratio=40)
    >>> print(log.recording.v.size, round(log.recording.turn_period_s, 4))
    2401 0.4
    """
    return open_log(log, form_of(log, said), v, said.get("torque"))


def estimate(log: object, v: ArrayLike | None = None, **words: Any) -> Estimate:
    """Estimate the backlash, which is half of the total play, that a log tells of.

    Parameters
    ----------
    log : str, Path, DataFrame, Log, or array of shape (samples,)
        A file, "-" for the standard input, a table, what `read_log` returned, or the time stamps [s] of `v`.
    v : array of shape (samples,), optional
        Motor speed, in rps or in `unit`; with `position=True` its position, in the turns (rps), rad (rad/s) or counts
        that go with `unit`.
    calibration : Calibration or path, optional
        Of your joint. Without one, method "self" takes the joint from the log; it knows joints under a drive of the
        paper's kind.
    method : str, optional
        "torque", "waveform", "energy", "amplitude", "paper" or "self", for the paper's kind of drive only; default:
        "torque" with a torque, the calibration's, else "self".
    repeats, seed : int
        Searches of method "paper", and the first seed.
    **words
        The fields of `LogFormat`, too: `turn_period_s` [s] or `gear_ratio`, and more. Method "torque", for any drive,
        needs `torque`, a column or an array, positive where it drives forward; `inertia_ratio`, J_l / (N^2 J_m), and
        `gravity_per_s2`, m g r / J_l, of the load, or `gear_ratio`, `motor_inertia_kgm2`, `load_mass_kg` and
        `load_arm_m`, and `load_inertia_kgm2` about the joint's axis if the load is no point; `inertia_sd` (0.1) and
        `gravity_sd` (0.05), relative SDs. The backlash is proportional to the gravity.

    Returns
    -------
    Estimate
        The verdict, the backlash [rad] with its 95 % interval, and warnings; None where nothing is known.

    Raises
    ------
    Refusal
        The log, the calibration or what is said of them cannot be used.

    Examples
    --------
    >>> import backlash
    >>> answer = backlash.estimate(t, v, turn_period_s=0.4, unit="rps")
    >>> print(answer.verdict, len(answer.backlash_interval_rad or ()))
    backlash 2
    """
    return examine(log, settings_of(log, words), v, words.get("torque")).estimate


def calibrate(
    logs: Sequence[object],
    delta_rad: Sequence[float],
    *,
    method: str = "waveform",
    repeats: int = 30,
    seed: int = 1,
    **said: Any,
) -> Calibration:
    """Calibrate a method on logs of one joint in one movement; parameters not named here are those of `estimate`.

    Parameters
    ----------
    logs : sequence of logs
        Paths, tables, or what `read_log` returned.
    delta_rad : sequence of float
        Their known backlashes, half of the total play [rad]; six different ones or more.
    method : str
        Any but "self".
    repeats, seed : int
        As in `estimate`.

    Returns
    -------
    Calibration
        With its `uncertainty_rad` and `range_rad`; `to_json` gives the text of its file.

    Raises
    ------
    Refusal
        A log cannot be used, there are too few levels, several movements, a negative backlash, no monotonic relation,
        or the uncertainty is more than a quarter of the range.

    Examples
    --------
    >>> import backlash
    >>> own = backlash.calibrate(logs, known_rad, method="energy", turn_period_s=0.4)
    >>> print(own.method, own.range_rad)
    energy (0.0004, 0.0016)
    """
    read = []
    for log in logs:
        try:
            read.append(detect_pattern(open_log(log, form_of(log, said)), seed))
        except Refusal as refusal:
            if refusal.is_unusable:
                raise
            raise Refusal(f"{name_of(log)}: no use for a calibration: {refusal}") from refusal
    speeds = b"".join(log.recording.v.tobytes() for log in read)
    made_of = f"{len(read)} logs, SHA-256 of their speeds {hashlib.sha256(speeds).hexdigest()}"
    return fit_calibration(
        [log.recording for log in read], delta_rad, method, made_of, repeats, seed
    )


def trend(
    logs: Sequence[object],
    dates: Sequence[Any] | str | PathLike[str] | None = None,
    *,
    limit_rad: float | None = None,
    relative: bool = False,
    jobs: int = 1,
    **words: Any,
) -> Trend:
    """Fit a line to the backlashes of dated logs of one joint; parameters not named here are those of `estimate`.

    Parameters
    ----------
    logs : sequence of logs
        Paths, tables, or what `read_log` returned; one without a backlash is left out, and a warning says why.
    dates : sequence of dates, or path, optional
        As pandas reads them, or a table with columns file and date; else those in the files' names, like 2024-03-17.
    limit_rad : float, optional
        The backlash, half of the total play, whose date is wanted [rad].
    relative : bool
        Take the oscillations' amplitudes, in percent of the first; so it is by itself where no log has an answer.
    jobs : int
        Processes; -1 for all cores where that is worth it.

    Returns
    -------
    Trend
        The line, and the date on which it crosses the limit with its 95 % interval.

    Raises
    ------
    Refusal
        A date is missing, there are fewer than three, or the limit is not finite and above zero.

    Examples
    --------
    >>> import backlash
    >>> worn = backlash.trend(logs, dates, method="energy", turn_period_s=0.4, limit_rad=2e-3)
    >>> print(worn.alarm, worn.crossing.year)
    True 2024
    """
    settings = settings_of_all(logs, words)
    if dates is None or isinstance(dates, str | PathLike):
        days = trend_line.dates_of([Path(name_of(log)) for log in logs], dates)
    else:
        days = list(pd.DatetimeIndex(dates))
    if len(days) != len(logs):
        raise Refusal(f"{len(logs)} logs and {len(days)} dates; give a date for each log")
    found = dict(fleet.run_fleet(logs, settings, jobs))
    answers = [found[number] for number in sorted(found)]
    return trend_line.fit_trend(fleet.as_table(answers), days, limit_rad, relative)
