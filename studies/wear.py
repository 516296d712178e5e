"""Eight months of wear on the stand-in bench: what sensors read at each test, and when they call."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.random import Generator
from pandas import DataFrame, concat

from backlash.calibration import Calibration, default_calibration
from backlash.fitting.global_fit import global_fit
from replication.arrays import FloatArray
from replication.files import ROOT
from replication.standins import Bench, draw_bench, encoder_log
from studies.benchmark import KnownLog, Row, logs_by_methods, self_answer, widened_answers


@dataclass(frozen=True)
class Wear:
    """Backlash over the months under stress, delta(t) = first + (last - first) (t / duration)^exponent."""

    first_rad: float
    last_rad: float
    exponent: float
    duration_days: float = 240.0
    interval_days: float = 21.0

    @property
    def test_days(self) -> FloatArray:
        """Days of the tests, the first on day 0."""
        return np.arange(0.0, self.duration_days + 1e-9, self.interval_days)

    def backlash_rad(self, day: FloatArray | float) -> FloatArray | float:
        """Backlash on a day [rad]."""
        growth = (np.asarray(day) / self.duration_days) ** self.exponent
        return self.first_rad + (self.last_rad - self.first_rad) * growth

    def crossing_day(self, limit_rad: float) -> float:
        """Day on which the backlash reaches a limit between its first and last value."""
        share = (limit_rad - self.first_rad) / (self.last_rad - self.first_rad)
        return float(self.duration_days * share ** (1 / self.exponent))


def draw_wear(rng: Generator, limit_rad: float) -> Wear:
    """Draw a wear that starts well below a limit and passes it within the eight months."""
    first = limit_rad * rng.uniform(0.2, 0.5)
    last = limit_rad * rng.uniform(1.2, 1.6)
    return Wear(first, last, rng.uniform(1.0, 3.0))


# Sensors that know the paper's joint, by the method of their calibration.
CALIBRATED = {"equation 10": "paper", "amplitude, calibrated": "amplitude", "waveform": "waveform"}
COLUMNS = ["bench", "sensor", "day", "delta_rad", "A_rps", "estimate_rad", "low_rad", "high_rad"]


KEPT = ROOT / "results" / "table3_wear.csv"
LIMIT_RAD = 1e-3


def follow_wear(benches: int = 8, limit_rad: float = LIMIT_RAD, seed: int = 1) -> DataFrame:
    """Draw benches that wear, and read each log by every sensor."""
    rng = np.random.default_rng((seed, 1))
    first = draw_bench(np.random.default_rng(seed))  # the one of Table 3
    drawn = [first, *(draw_bench(rng) for _ in range(benches - 1))]
    wears = [draw_wear(rng, limit_rad) for _ in drawn]
    sensors = {name: default_calibration(method) for name, method in CALIBRATED.items()}
    return wear_tests(drawn, wears, sensors, limit_rad, seed)


def wear_tests(
    benches: Sequence[Bench],
    wears: Sequence[Wear],
    calibrations: Mapping[str, Calibration],
    limit_rad: float,
    seed: int,
) -> DataFrame:
    """Test worn benches every few weeks: each sensor's reading, and when the truth and it reach the limit."""

    def by_calibration(log: KnownLog) -> dict[str, Row]:
        fit = global_fit(log.recording)
        answers = widened_answers(log.recording, fit, calibrations)
        return {name: {"A_rps": fit.amplitude_rps} | answer for name, answer in answers.items()}

    def by_self(log: KnownLog) -> dict[str, Row]:
        return {"self-calibrating": self_answer(log.recording)}

    logs = _logs(benches, wears, seed)
    calibrated = logs_by_methods(logs, by_calibration)
    by_themselves = logs_by_methods(logs, by_self)
    rows = concat(
        [calibrated, by_themselves[~by_themselves["refused"].astype(bool)]], ignore_index=True
    )
    table = rows.rename(columns={"method": "sensor", "found_rad": "estimate_rad"})[COLUMNS]
    table["truth_day"] = table["bench"].map(lambda number: wears[number].crossing_day(limit_rad))
    called = table["day"].where(table["estimate_rad"] >= limit_rad)
    return table.assign(call_day=called.groupby([table["sensor"], table["bench"]]).transform("min"))


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
