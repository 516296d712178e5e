"""From what a method reads to the backlash: calibrations, made with the estimator that measures."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.polynomial import Polynomial
from scipy.special import ndtri, stdtrit

from backlash.fitting import SENSOR_METHODS
from backlash.fitting.readings import METHODS, Reading, read
from backlash.fitting.waveform import (
    LEAST_LEVELS,
    WaveformBank,
    make_bank,
    match,
    mean_turn,
    samples_a_turn,
)
from backlash.reading.sources import MOST_TABLE_BYTES, naming, read_bytes
from backlash.refusals import Refusal
from replication.arrays import FloatArray
from replication.characteristic import first_rise, printed_levels_rad
from replication.records import TURN_PERIOD_S, Recording
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings

_DATA = Path(__file__).with_name("data")
# Most phases in a turn that a waveform keeps: those of the default one, sampled at 0.5 ms.
_MOST_PHASES = 800
SIMULATED = "the paper's joint as identified, simulated"
# Of a calibration's range, the most uncertainty: the 95 % interval is then as wide as the range,
# and says nothing.
_MOST_UNCERTAINTY = 0.25
# How far a log's turn may be from that of the calibration: the waveform scales with the speed.
PERIOD_MISMATCH = 0.02
_NO_CALIBRATION = (
    ArithmeticError,
    AttributeError,
    LookupError,
    RecursionError,
    TypeError,
    ValueError,
)
MOST_RAD = 0.1  # a larger backlash is taken for one in mrad


@dataclass(frozen=True)
class Backlash:
    """Backlash with its 95 % interval [rad], and whether the calibration had to be extrapolated."""

    delta_rad: float
    interval_rad: tuple[float, float]
    extrapolated: bool


@dataclass(frozen=True, eq=False)
class Calibration:
    """From the value that a method reads to the backlash, for one joint in one movement; made by `calibrate`."""

    method: str  # that reads, and that read the calibration's own logs
    coefficients: tuple[float, ...]  # of delta(value), from the constant up; none for "waveform"
    range_rad: tuple[float, float]  # least and largest backlash of its logs
    # RMS error at inner levels left out, times Student's factor for so few of them.
    uncertainty_rad: float
    turn_period_s: float
    commanded_speed_rps: float
    provenance: str  # what it was made from
    bank: WaveformBank | None = None  # for "waveform"

    def delta_rad(self, value: float) -> float:
        """Backlash [rad] of a value, by the polynomial alone."""
        return float(Polynomial(self.coefficients)(value)) if self.bank is None else float(value)

    def value_at(self, delta_rad: float) -> float:
        """Value that the polynomial gives a backlash: the smallest positive one where it grows."""
        return first_rise(self.coefficients, delta_rad) or 0.0

    def backlash(self, reading: Reading) -> Backlash:
        """Turn a reading into backlash; the interval adds the record's noise and the calibration's uncertainty."""
        delta = self.delta_rad(reading.value)
        ends = [self.delta_rad(end) for end in reading.interval]
        own = 1.96 * self.uncertainty_rad
        low = float(delta - np.hypot(delta - min(ends), own))
        high = float(delta + np.hypot(max(ends) - delta, own))
        outside = not self.range_rad[0] <= delta <= self.range_rad[1] or reading.at_end
        return Backlash(delta, (low, high), outside)

    def other_movement(self, recording: Recording) -> str:
        """How a record's movement differs from the calibration's; empty if it does not."""
        speed = float(recording.v.mean())
        for what, here, known, unit in (
            ("a load turn takes", recording.turn_period_s, self.turn_period_s, "s"),
            ("the motor makes", speed, self.commanded_speed_rps, "rps"),
        ):
            if abs(here / known - 1) > PERIOD_MISMATCH:
                return f"{what} {here:.4g} {unit}, in the calibration {known:.4g} {unit}"
        return ""

    def to_dict(self) -> dict[str, object]:
        """What `from_json` reads, ready for JSON."""
        content: dict[str, Any] = {"method": self.method, "unit": "rad"} | asdict(self)
        del content["bank"]
        if self.bank is not None:
            rounded = [[float(f"{v:.6g}") for v in row] for row in self.bank.waveform_rps]
            content["waveforms"] = {
                "delta_rad": self.bank.delta_rad.tolist(),
                "waveform_rps": rounded,
            }
        return content

    def to_json(self) -> str:
        """Write as text, for `from_json`."""
        return json.dumps(self.to_dict(), indent=1) + "\n"

    @staticmethod
    def from_json(text: str, name: str) -> "Calibration":
        """Read what `to_json` wrote; an Refusal says after `name` what is wrong with it."""
        try:
            content = json.loads(text)
            if waves := content.pop("waveforms", None):
                delta, turns = (np.array(waves[name]) for name in ("delta_rad", "waveform_rps"))
                content["bank"] = WaveformBank(delta, turns)
            content["range_rad"] = tuple(content["range_rad"])
            del content["unit"]
            why = _defect(found := Calibration(**content))
        except _NO_CALIBRATION as error:
            raise Refusal(
                f"{name}: not a calibration file ({type(error).__name__}: {error}); make one anew"
            ) from None
        if why:
            raise Refusal(f"{name}: not a usable calibration: {why}; make one anew")
        return found


OwnCalibration = Calibration | str | PathLike[str] | None


def read_calibration(source: OwnCalibration) -> Calibration | None:
    """Read a calibration file; refuse in one line what is none."""
    if source is None or isinstance(source, Calibration):
        return source
    with naming(str(source)):
        text = read_bytes(str(source), MOST_TABLE_BYTES).decode("utf-8")
    return Calibration.from_json(text, str(source))


def _defect(found: Calibration) -> str:
    """What no calibration of ours could have; empty if there is nothing of the kind."""
    bank, (low, high) = found.bank, found.range_rad
    is_bank = bank is None or (
        bank.waveform_rps.ndim == 2
        and bank.waveform_rps.shape[:1] == bank.delta_rad.shape
        and bank.delta_rad.size >= LEAST_LEVELS
        and np.isfinite([bank.waveform_rps.sum(), bank.delta_rad.sum()]).all()
        and (np.diff(bank.delta_rad) > 0).all()
    )
    checks = (
        (found.method in METHODS, f"method {found.method!r} is none of {', '.join(METHODS)}"),
        ((bank is not None) == (found.method == "waveform"), "only method waveform has waveforms"),
        (bank is not None or len(found.coefficients) >= 2, "no polynomial"),
        (
            np.isfinite(
                [
                    *(*found.coefficients, low, high, found.uncertainty_rad),
                    *(found.turn_period_s, found.commanded_speed_rps),
                ]
            ).all(),
            "a number is not finite",
        ),
        (0 <= low < high, "no range"),
        (min(found.turn_period_s, found.commanded_speed_rps) > 0, "no movement"),
        (found.uncertainty_rad >= 0, "a negative uncertainty"),
        (is_bank, "the waveforms do not fit their backlashes"),
    )
    return next((why for is_right, why in checks if not is_right), "")


def leave_one_out_sd(errors_rad: FloatArray) -> float:
    """SD that a normal error would have, had it the 95 % range of Student's for this RMS of so many errors."""
    return float(np.sqrt(np.mean(errors_rad**2)) * stdtrit(errors_rad.size, 0.975) / ndtri(0.975))


def fit_polynomial(
    value: FloatArray, delta: FloatArray, method: str
) -> tuple[tuple[float, ...], float]:
    """Cubic delta(value), equation 10's form, from the constant up, and its leave-one-level-out error [rad]."""
    cubic = Polynomial.fit(value, delta, 3).convert()
    along = np.linspace(value.min(), value.max(), 400)
    if not (cubic.deriv()(along) > 0).all():
        problem = "the backlash does not grow with the value over the range of these logs"
        cure = "check the known backlashes, add levels, or use another method"
        raise Refusal(f"method {method}: {problem}, so a value would have two meanings; {cure}")
    inner = np.unique(delta)[1:-1]
    errors = [
        Polynomial.fit(value[delta != d], delta[delta != d], 3).convert()(value[delta == d]) - d
        for d in inner
    ]
    return tuple(cubic.coef.tolist()), leave_one_out_sd(np.concatenate(errors))


def _bank_uncertainty(
    recordings: Sequence[Recording], delta: FloatArray, bank: WaveformBank
) -> float:
    """Leave-one-level-out error of a bank [rad]; refused where readings do not grow with the backlash."""
    level = np.searchsorted(bank.delta_rad, delta)
    inner = np.flatnonzero((level > 0) & (level < bank.delta_rad.size - 1)).tolist()
    found = np.array([match(recordings[k], bank.without(int(level[k]))).delta_rad for k in inner])
    by_level = [found[delta[inner] == d].mean() for d in bank.delta_rad[1:-1]]
    if not (np.diff(by_level) > 0).all():
        problem = "logs that the others predict do not come in the order of their backlashes"
        cure = "check the known backlashes, add logs if there are few, or use another method"
        raise Refusal(f"method waveform: {problem}; {cure}")
    return leave_one_out_sd(found - delta[inner])


def fit_calibration(
    recordings: Sequence[Recording],
    delta_rad: Sequence[float] | FloatArray,
    method: str,
    provenance: str = "",
    repeats: int = 30,
    seed: int = 1,
) -> Calibration:
    """Calibrate a method on records of known backlash; an Refusal says why that cannot be done."""
    delta = np.asarray(delta_rad, dtype=float)
    if delta.size != len(recordings) or not (np.isfinite(delta) & (delta >= 0)).all():
        raise Refusal("each log needs a known backlash, finite and not negative [rad]")
    if delta.max(initial=0.0) > MOST_RAD:
        raise Refusal(
            f"a known backlash of {delta.max():g} rad, above {MOST_RAD:g}: is the column in mrad?"
        )
    if np.unique(delta).size < LEAST_LEVELS:
        raise Refusal(
            f"{np.unique(delta).size} different backlashes; a calibration needs {LEAST_LEVELS} or more"
        )
    periods = np.array([recording.turn_period_s for recording in recordings])
    if np.ptp(periods) > PERIOD_MISMATCH * periods.mean():
        raise Refusal("the logs have different turn periods; calibrate one movement at a time")
    coefficients: tuple[float, ...] = ()
    bank = None
    if method == "waveform":
        phases = min(_MOST_PHASES, *(samples_a_turn(recording) for recording in recordings))
        bank = make_bank(delta.tolist(), [mean_turn(recording, phases) for recording in recordings])
        uncertainty = _bank_uncertainty(recordings, delta, bank)
    else:
        value = np.array(
            [read(recording, method, None, repeats, seed).value for recording in recordings]
        )
        coefficients, uncertainty = fit_polynomial(value, delta, method)
    speed = float(np.mean([recording.commanded_speed_rps for recording in recordings]))
    range_rad = float(delta.min()), float(delta.max())
    if (share := uncertainty / np.ptp(delta)) > _MOST_UNCERTAINTY:
        known = f"the uncertainty, {1e3 * uncertainty:.3f} mrad, is {share:.0%} of the range of the known backlashes"
        raise Refusal(f"method {method}: {known}; check them, add logs, or use another method")
    return Calibration(
        method, coefficients, range_rad, uncertainty, float(periods.mean()), speed, provenance, bank
    )


@lru_cache(maxsize=len(METHODS))
def default_calibration(method: str) -> Calibration:
    """Calibration of a method for the paper's joint; that of "waveform" is too large to be kept."""
    if method not in METHODS:
        raise Refusal(f"method {method!r}: there are {', '.join(SENSOR_METHODS)}")
    if method == "waveform":
        # Table 2's range of backlash, and a little beyond.
        wide = np.round(np.arange(1e-4, printed_levels_rad()[-1] + 4.5e-4, 1e-4), 6).tolist()
        sample_s = TURN_PERIOD_S / _MOST_PHASES
        records = simulate_recordings(identified_joint(), wide, sample_s, turns=3)
        return fit_calibration(records, wide, method, SIMULATED)
    kept = json.loads((_DATA / "default_calibrations.json").read_text(encoding="utf-8"))
    return Calibration.from_json(json.dumps(kept[method]), "default_calibrations.json")


@lru_cache(maxsize=1)
def shares() -> dict[str, float]:
    """By method: 95 % of the errors on uncalibrated benches are below this share of the backlash found."""
    return pd.read_csv(_DATA / "spread_of_joints.csv", index_col="method")["share_95"].to_dict()


def widened(
    method: str, delta_rad: float, interval_rad: tuple[float, float]
) -> tuple[float, float]:
    """Interval [rad] of a backlash by the paper's joint's calibration, the spread of joints added to the noise."""
    arms = np.hypot(np.subtract(interval_rad, delta_rad), shares()[method] * delta_rad)
    return float(delta_rad - arms[0]), float(delta_rad + arms[1])
