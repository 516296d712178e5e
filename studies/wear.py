"""Eight months of wear on the stand-in bench: what sensors read at each test, and when they call."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from pandas import DataFrame

from backlash.calibration import Calibration
from backlash.fitting.global_fit import global_fit
from backlash.fitting.shared_joint import share_joint
from replication.standins.joints import Bench, encoder_log
from replication.standins.wear import Wear
from studies.benchmark import KnownLog, Row, logs_by_methods, self_answer, widened_answers


def wear_tests(
    benches: Sequence[Bench],
    wears: Sequence[Wear],
    calibrations: Mapping[str, Calibration],
    limit_rad: float,
    seed: int,
) -> DataFrame:
    """Test worn benches every few weeks and read the backlash off each log."""

    def answers(log: KnownLog) -> dict[str, Row]:
        fit = global_fit(log.recording)
        found = widened_answers(log.recording, fit, calibrations)
        return {name: {"A_rps": fit.amplitude_rps} | answer for name, answer in found.items()}

    return _with_calls(logs_by_methods(_logs(benches, wears, seed), answers), wears, limit_rad)


def wear_tests_by_self(
    benches: Sequence[Bench], wears: Sequence[Wear], limit_rad: float, seed: int
) -> DataFrame:
    """Read the logs of `wear_tests` by method "self": each alone, and with all logs of its bench until then."""
    table = logs_by_methods(
        _logs(benches, wears, seed), lambda log: {"self-calibrating": self_answer(log.recording)}
    )
    fits: dict[int, list] = defaultdict(list)
    rows = []
    for alone in table[~table["refused"]].to_dict("records"):
        of_bench = fits[alone["bench"]]
        of_bench.append(alone["fit"])
        shared, (low, high) = share_joint(of_bench)[-1]
        found = {
            "method": "self-calibrating, one joint for all logs",
            "found_rad": shared,
            "low_rad": low,
            "high_rad": high,
        }
        rows += [alone, alone | found]
    return _with_calls(DataFrame(rows), wears, limit_rad)


def _logs(
    benches: Sequence[Bench], wears: Sequence[Wear], seed: int
) -> list[Callable[[], KnownLog]]:
    """Draw the log of each bench on each of its days."""

    def draw(index: int, number: int, day: float) -> KnownLog:
        delta = float(wears[number].backlash_rad(day))
        recording = encoder_log(benches[number], delta, np.random.default_rng((seed, index)))
        return KnownLog({"bench": number, "day": day}, delta, recording)

    tests = [(number, day) for number, wear in enumerate(wears) for day in wear.test_days]
    return [partial(draw, index, *test) for index, test in enumerate(tests)]


def _with_calls(rows: DataFrame, wears: Sequence[Wear], limit_rad: float) -> DataFrame:
    """Columns of tests, and the days on which the truth and each sensor reach the limit."""
    columns = [
        "bench",
        "sensor",
        "day",
        "delta_rad",
        "A_rps",
        "estimate_rad",
        "low_rad",
        "high_rad",
    ]
    table = rows.rename(columns={"method": "sensor", "found_rad": "estimate_rad"}).reindex(
        columns=columns
    )
    table["truth_day"] = table["bench"].map(lambda number: wears[number].crossing_day(limit_rad))
    called = table["day"].where(table["estimate_rad"] >= limit_rad)
    return table.assign(call_day=called.groupby([table["sensor"], table["bench"]]).transform("min"))
