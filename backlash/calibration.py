"""Calibrations of method "waveform": logs of one joint, in one movement, at known backlashes."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from os import PathLike

import numpy as np
from scipy.special import ndtri, stdtrit

from backlash.reading.sources import MOST_TABLE_BYTES, naming, read_bytes
from backlash.refusals import Refusal
from backlash.turns import harmonics
from backlash.waveform import FASTEST_HZ, LEAST_LEVELS, WaveformBank, make_bank, match
from replication.joint import identified_joint, simulate
from replication.records import Recording
from replication.signature import FloatArray

MOST_RAD = 0.1  # a larger backlash is taken for one in mrad
# Of turn and speed: the waveform scales with the speed, by less than its uncertainty.
MISMATCH = 0.02
# Of the range, the largest uncertainty: its 95 % interval is then as wide as the range, and says nothing.
_MOST_UNCERTAINTY = 0.25
# Table 2's range of backlash, and a little beyond.
_EXAMPLE_RAD = np.round(np.arange(1e-4, 25.5e-4, 1e-4), 6)
_EXAMPLE_PHASES = 800  # in a turn: 0.5 ms
EXAMPLE = "an example: the paper's joint as identified, simulated, not your joint"


@dataclass(frozen=True, eq=False)
class Calibration:
    """Waveforms at known backlashes, for one joint in one movement; made by `calibrate`."""

    bank: WaveformBank
    uncertainty_rad: (
        float  # RMS error at inner levels left out, times Student's factor for so few of them
    )
    turn_period_s: float
    commanded_speed_rps: float
    provenance: str  # what it was made from

    @property
    def range_rad(self) -> tuple[float, float]:
        """Least and largest backlash of its logs."""
        return float(self.bank.delta_rad[0]), float(self.bank.delta_rad[-1])

    def other_movement(self, recording: Recording) -> str:
        """How a record's movement differs from the calibration's; empty if it does not."""
        for what, here, there, unit in (
            ("a load turn takes", recording.turn_period_s, self.turn_period_s, "s"),
            ("the motor makes", float(recording.v.mean()), self.commanded_speed_rps, "rps"),
        ):
            if abs(here / there - 1) > MISMATCH:
                return f"{what} {here:.4g} {unit}, in the calibration {there:.4g} {unit}"
        return ""

    def to_json(self) -> str:
        """Write as text, for `read_calibration`."""
        parts = np.stack([self.bank.harmonics_rps.real, self.bank.harmonics_rps.imag], axis=-1)
        content = {
            "method": "waveform",
            "unit": "rad",
            "uncertainty_rad": self.uncertainty_rad,
            "turn_period_s": self.turn_period_s,
            "commanded_speed_rps": self.commanded_speed_rps,
            "provenance": self.provenance,
            "delta_rad": self.bank.delta_rad.tolist(),
            "harmonics_rps": parts.round(8).tolist(),
        }
        return json.dumps(content, indent=1) + "\n"


def read_calibration(source: Calibration | str | PathLike[str] | None) -> Calibration | None:
    """Read a calibration file; refuse in one line what is none."""
    if source is None or isinstance(source, Calibration):
        return source
    with naming(str(source)):
        text = read_bytes(str(source), MOST_TABLE_BYTES).decode("utf-8")
    try:
        content = json.loads(text)
        parts = np.array(content["harmonics_rps"], dtype=float)
        bank = WaveformBank(np.array(content["delta_rad"], dtype=float), parts @ np.array([1, 1j]))
        others = {field.name: content[field.name] for field in fields(Calibration)[1:]}
        made = Calibration(bank, **others)
        _check(made)
    except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise Refusal(
            f"{source}: not a calibration file ({type(error).__name__}: {error}); make one anew"
        ) from None
    return made


def _check(made: Calibration) -> None:
    """Refuse what no calibration of ours could have."""
    delta, lines = made.bank.delta_rad, made.bank.harmonics_rps
    if lines.ndim != 2 or lines.shape[:1] != delta.shape or delta.size < LEAST_LEVELS:
        raise ValueError("the harmonics do not fit their backlashes")
    numbers = (made.uncertainty_rad, made.turn_period_s, made.commanded_speed_rps, *np.diff(delta))
    is_finite = np.isfinite([lines.sum(), *numbers]).all()
    if not (is_finite and min(numbers) > 0 and delta[0] >= 0):
        raise ValueError(
            "a number is not finite, or not above 0, or the backlashes do not increase"
        )


def _bank_uncertainty(
    recordings: Sequence[Recording], delta: FloatArray, bank: WaveformBank
) -> float:
    """Leave-one-level-out error of a bank [rad]; refused where matches do not grow with the backlash."""
    level = np.searchsorted(bank.delta_rad, delta)
    inner = np.flatnonzero((level > 0) & (level < bank.delta_rad.size - 1)).tolist()
    matched = np.array([match(recordings[k], bank.without(int(level[k]))).delta_rad for k in inner])
    if not (np.diff([matched[delta[inner] == d].mean() for d in bank.delta_rad[1:-1]]) > 0).all():
        raise Refusal(
            "logs that the others predict do not come in the order of their backlashes; check the known backlashes, or "
            "add logs if there are few"
        )
    rms = np.sqrt(np.mean((matched - delta[inner]) ** 2))
    # The SD of a normal error with the 95 % range of Student's for this RMS of so few errors.
    return float(rms * stdtrit(len(inner), 0.975) / ndtri(0.975))


def fit_calibration(
    recordings: Sequence[Recording], delta_rad: Sequence[float] | FloatArray, provenance: str = ""
) -> Calibration:
    """Calibrate on records of known backlash; a Refusal says why that cannot be done."""
    delta = np.asarray(delta_rad, dtype=float)
    if delta.size != len(recordings) or not (np.isfinite(delta) & (delta >= 0)).all():
        raise Refusal("each log needs a known backlash, finite and not negative [rad]")
    if delta.max(initial=0.0) > MOST_RAD:
        raise Refusal(
            f"a known backlash of {delta.max():g} rad, above {MOST_RAD:g}: is the column in mrad?"
        )
    if (levels := np.unique(delta).size) < LEAST_LEVELS:
        raise Refusal(f"{levels} different backlashes; a calibration needs {LEAST_LEVELS} or more")
    periods = np.array([recording.turn_period_s for recording in recordings])
    if np.ptp(periods) > MISMATCH * periods.mean():
        raise Refusal("the logs have different turn periods; calibrate one movement at a time")
    turns = [harmonics(recording, recording.v, FASTEST_HZ).coefficient for recording in recordings]
    bank = make_bank(delta.tolist(), turns)
    uncertainty = _bank_uncertainty(recordings, delta, bank)
    if (share := uncertainty / np.ptp(delta)) > _MOST_UNCERTAINTY:
        raise Refusal(
            f"the uncertainty, {1e3 * uncertainty:.3f} mrad, is {share:.0%} of the range of the known backlashes; "
            "check them, or add logs"
        )
    speed = float(np.mean([recording.commanded_speed_rps for recording in recordings]))
    return Calibration(bank, uncertainty, float(periods.mean()), speed, provenance)


@lru_cache(maxsize=1)
def example_calibration() -> Calibration:
    """The calibration of the paper's joint, simulated: an example for whoever has none."""
    joint = identified_joint()
    period = 2 * np.pi * joint.N / joint.Omega
    records = []
    for delta in _EXAMPLE_RAD:
        run = simulate(joint, float(delta), duration=3 * period, sample=period / _EXAMPLE_PHASES)
        records.append(
            Recording(run.t[:-1], run.v[:-1], joint.Omega / (2 * np.pi), period, EXAMPLE)
        )
    return fit_calibration(records, _EXAMPLE_RAD, EXAMPLE)
