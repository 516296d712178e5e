"""Eight months of wear on the stand-in bench: what the sensor reads at each test, and when it calls for maintenance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from replication.arrays import FloatArray
from replication.global_fit.fit import global_fit
from replication.methods.calibration import Calibration, backlashes
from replication.methods.self_calibration import SelfFit, fit_joint
from replication.methods.shared_joint import share_joint
from replication.methods.spread import widened
from replication.standins.joints import Bench, encoder_log


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


def draw_wear(rng: np.random.Generator, limit_rad: float) -> Wear:
    """Draw a wear that starts well below a limit and passes it within the eight months."""
    first, last = limit_rad * rng.uniform(0.2, 0.5), limit_rad * rng.uniform(1.2, 1.6)
    return Wear(float(first), float(last), float(rng.uniform(1.0, 3.0)))


def _read_log(
    bench: Bench, delta_rad: float, seed: Sequence[int], calibrations: Mapping[str, Calibration]
) -> list[tuple[float, float, float, float]]:
    """A [rps], and estimate, low and high end of the backlash [rad], by each calibration; one global fit for all."""
    record = encoder_log(bench, delta_rad, np.random.default_rng(seed))
    fit = global_fit(record)
    return [
        (fit.amplitude_rps, found.delta_rad,
         *widened(calibrations[name].method, found.delta_rad, found.interval_rad))
        for name, found in backlashes(record, fit, calibrations).items()
    ]  # fmt: skip


def wear_tests(
    benches: Sequence[Bench],
    wears: Sequence[Wear],
    calibrations: Mapping[str, Calibration],
    limit_rad: float,
    seed: int,
) -> pd.DataFrame:
    """Test worn benches every few weeks and read the backlash off each log."""
    tests = _tests(wears)
    jobs = [
        delayed(_read_log)(benches[number], delta, (seed, index), calibrations)
        for index, (number, _, delta) in enumerate(tests)
    ]
    readings = Parallel(n_jobs=-1, batch_size=4)(jobs)
    rows = [
        (number, name, day, delta, *reading)
        for (number, day, delta), of_test in zip(tests, readings, strict=True)
        for name, reading in zip(calibrations, of_test, strict=True)
    ]
    return _with_calls(rows, wears, limit_rad)


def wear_tests_by_self(benches: Sequence[Bench], wears: Sequence[Wear], limit_rad: float, seed: int) -> pd.DataFrame:
    """Read the logs of `wear_tests` by method "self": each alone, and with all logs of its bench until then."""
    tests = _tests(wears)
    jobs = [delayed(_fit_log)(benches[number], delta, (seed, index)) for index, (number, _, delta) in enumerate(tests)]
    fits = Parallel(n_jobs=-1, batch_size=4)(jobs)
    rows, answered = [], {number: [] for number in range(len(benches))}
    for (number, day, delta), fit in zip(tests, fits, strict=True):
        if fit.refusal_reason:
            continue
        answered[number].append(fit)
        shared, interval = share_joint(answered[number])[-1]
        rows.append((number, "self", day, delta, np.nan, fit.delta_rad, *fit.interval_rad))
        rows.append((number, "self, shared joint", day, delta, np.nan, shared, *interval))
    return _with_calls(rows, wears, limit_rad)


def _fit_log(bench: Bench, delta_rad: float, seed: Sequence[int]) -> SelfFit:
    return fit_joint(encoder_log(bench, delta_rad, np.random.default_rng(seed)))


def _tests(wears: Sequence[Wear]) -> list[tuple[int, float, float]]:
    """Bench, day and true backlash [rad] of every test."""
    return [(number, day, float(wear.backlash_rad(day))) for number, wear in enumerate(wears) for day in wear.test_days]


def _with_calls(rows: list[tuple], wears: Sequence[Wear], limit_rad: float) -> pd.DataFrame:
    """Rows of tests as a table, with the days on which the truth and each sensor reach the limit."""
    columns = ["bench", "sensor", "day", "delta_rad", "A_rps", "estimate_rad", "low_rad", "high_rad"]
    table = pd.DataFrame(rows, columns=columns)
    table["truth_day"] = table["bench"].map(lambda number: wears[number].crossing_day(limit_rad))
    called = table["day"].where(table["estimate_rad"] >= limit_rad)
    return table.assign(call_day=called.groupby([table["sensor"], table["bench"]]).transform("min"))


def maintenance_calls(tests: pd.DataFrame) -> pd.DataFrame:
    """Condense `wear_tests` into one row per sensor: how the calls lie to the truth."""
    rows = []
    for name, part in tests.groupby("sensor", sort=False):
        each = part.drop_duplicates("bench")
        delay = each["call_day"] - each["truth_day"]
        error = part["estimate_rad"] - part["delta_rad"]
        covered = (part["low_rad"] <= part["delta_rad"]) & (part["delta_rad"] <= part["high_rad"])
        rows.append(
            {
                "sensor": name,
                "benches": len(each),
                "early": int((delay < 0).sum()),
                "late": int((delay > part["day"].drop_duplicates().diff().max()).sum()),
                "missed": int(delay.isna().sum()),
                "median_days": delay.median(),
                "earliest_days": delay.min(),
                "latest_days": delay.max(),
                "mean_error_rad": error.mean(),
                "sd_error_rad": error.std(),
                "covered_percent": 100 * covered.mean(),
            }
        )
    return pd.DataFrame(rows)
