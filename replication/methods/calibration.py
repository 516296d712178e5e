"""From what a method reads to the backlash: calibrations, made with the estimator that measures."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from importlib.resources import files

import numpy as np
from numpy.polynomial import Polynomial
from scipy import stats

from replication.characteristic import RPM_PER_RPS, equation_10, printed_levels_rad
from replication.datasets import COMMANDED_SPEED_RPS, TURN_PERIOD_S, FloatArray, Recording
from replication.global_fit.fit import GlobalFit
from replication.methods.readings import METHODS, Reading, read, reading_of_fit
from replication.methods.waveform import LEAST_LEVELS, WaveformBank, make_bank, match, mean_turn, samples_a_turn
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import identified_joint

# Most phases in a turn that a waveform keeps: those of the default one, sampled at 0.5 ms.
_MOST_PHASES = 800

_KEPT = "data/default_calibrations.json"

# How far a log's turn may be from that of the calibration: the waveform scales with the speed.
PERIOD_MISMATCH = 0.02


@dataclass(frozen=True)
class Backlash:
    """Backlash with its 95 % interval [rad], and whether the calibration had to be extrapolated."""

    delta_rad: float
    interval_rad: tuple[float, float]
    extrapolated: bool


@dataclass(frozen=True, eq=False)
class Calibration:
    """From the value that a method reads to the backlash, for one joint in one movement."""

    method: str  # that reads, and that read the calibration's own logs
    coefficients: tuple[float, ...]  # of delta(value), from the constant up; none for "waveform"
    bank: WaveformBank | None  # for "waveform"
    range_rad: tuple[float, float]  # least and largest backlash of its logs
    uncertainty_rad: float  # RMS error at inner levels left out, times Student's factor for so few of them
    turn_period_s: float
    commanded_speed_rps: float
    provenance: str  # what it was made from

    def delta_rad(self, value: float) -> float:
        """Backlash [rad] of a value, by the polynomial alone."""
        return float(Polynomial(self.coefficients)(value)) if self.bank is None else float(value)

    def backlash(self, reading: Reading) -> Backlash:
        """Turn a reading into backlash; the interval adds the record's noise and the calibration's uncertainty."""
        if reading.method != self.method:
            raise ValueError(f"a calibration of method {self.method} cannot use a reading of method {reading.method}")
        delta = self.delta_rad(reading.value)
        ends = [self.delta_rad(end) for end in reading.interval]
        own = 1.96 * self.uncertainty_rad
        low, high = delta - np.hypot(delta - min(ends), own), delta + np.hypot(max(ends) - delta, own)
        outside = not self.range_rad[0] <= delta <= self.range_rad[1] or "backlash" in reading.at_bound
        return Backlash(delta, (float(low), float(high)), bool(outside))

    def to_json(self) -> str:
        """Write as text, for `from_json`."""
        return json.dumps(self.content(), indent=1) + "\n"

    def content(self) -> dict:
        """What the file holds."""
        found = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "bank"}
        found = {"method": found.pop("method"), "unit": "rad"} | found
        if self.bank is not None:
            rounded = [[float(f"{v:.6g}") for v in row] for row in self.bank.waveform_rps]
            found["waveforms"] = {"delta_rad": self.bank.delta_rad.tolist(), "waveform_rps": rounded}
        return found

    @staticmethod
    def from_json(text: str, name: str) -> "Calibration":
        """Read what `to_json` wrote; a ValueError says in one line, after `name`, what is wrong with it."""
        try:
            content = json.loads(text)
            waves = content.get("waveforms")
            parts = [np.array(waves[key], float) for key in ("delta_rad", "waveform_rps")] if waves else []
            calibration = Calibration(
                str(content["method"]),
                tuple(float(c) for c in content["coefficients"]),
                WaveformBank(*parts) if parts else None,
                tuple(float(end) for end in content["range_rad"]),
                *(float(content[key]) for key in ("uncertainty_rad", "turn_period_s", "commanded_speed_rps")),
                str(content["provenance"]),
            )
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise ValueError(
                f"{name}: not a calibration file ({type(error).__name__}: {error}); make one anew"
            ) from None
        _check(calibration, name)
        return calibration


def _check(calibration: Calibration, name: str) -> None:
    """Refuse a calibration that no calibration of ours could be."""
    numbers = [*calibration.coefficients, *calibration.range_rad, calibration.uncertainty_rad]
    range_rad = calibration.range_rad
    wrong = (
        (calibration.method not in METHODS, f"method {calibration.method!r} is none of {', '.join(METHODS)}"),
        ((calibration.bank is None) == (calibration.method == "waveform"), "only method waveform has waveforms"),
        (calibration.bank is None and len(calibration.coefficients) < 2, "no polynomial"),
        (not np.isfinite(numbers).all(), "a number is not finite"),
        (len(range_rad) != 2 or not 0 <= range_rad[0] < range_rad[-1], "no range"),
        (not min(calibration.turn_period_s, calibration.commanded_speed_rps) > 0, "no movement"),
        (calibration.uncertainty_rad < 0, "a negative uncertainty"),
        (calibration.bank is not None and not _fits(calibration.bank), "the waveforms do not fit their backlashes"),
    )
    for is_wrong, why in wrong:
        if is_wrong:
            raise ValueError(f"{name}: not a usable calibration: {why}; make one anew")


def _fits(bank: WaveformBank) -> bool:
    """Whether a bank has a finite waveform for each of its increasing backlashes."""
    delta, waves = bank.delta_rad, bank.waveform_rps
    shaped = delta.ndim == 1 and waves.ndim == 2 and len(waves) == delta.size >= LEAST_LEVELS
    return bool(shaped and (np.diff(delta) > 0).all() and np.isfinite(delta).all() and np.isfinite(waves).all())


def backlashes(recording: Recording, fit: GlobalFit, calibrations: Mapping[str, Calibration]) -> dict[str, Backlash]:
    """Backlash of a record by several calibrations, from its one global fit; keys as in `calibrations`."""
    return {
        name: calibration.backlash(reading_of_fit(recording, calibration.method, fit, calibration.bank))
        for name, calibration in calibrations.items()
    }


def _fitted(value: FloatArray, delta: FloatArray) -> Polynomial:
    """Cubic delta(value), equation 10's form."""
    return Polynomial.fit(value, delta, 3).convert()


def _left_out_errors(value: FloatArray, delta: FloatArray) -> FloatArray:
    """Error at each inner level of the cubic through the others [rad]."""
    inner = (delta > delta.min()) & (delta < delta.max())
    levels = np.unique(delta[inner])
    return np.concatenate([_fitted(value[delta != d], delta[delta != d])(value[delta == d]) - d for d in levels])


def _uncertainty(errors_rad: FloatArray) -> float:
    """SD that a normal error would have, had it the 95 % range of Student's for this RMS of so many errors."""
    return float(np.sqrt(np.mean(errors_rad**2)) * stats.t.ppf(0.975, errors_rad.size) / stats.norm.ppf(0.975))


def fit_polynomial(value: FloatArray, delta: FloatArray, method: str) -> tuple[tuple[float, ...], float]:
    """Coefficients, from the constant up, of the cubic delta(value), and its leave-one-level-out error [rad]."""
    cubic = _fitted(value, delta)
    along = np.linspace(value.min(), value.max(), 400)
    if not (cubic.deriv()(along) > 0).all():
        raise ValueError(
            f"method {method}: the backlash does not grow with the value over the range of these logs, so a value "
            "would have two meanings; check the known backlashes, add levels, or use another method"
        )
    return tuple(float(c) for c in cubic.coef), _uncertainty(_left_out_errors(value, delta))


def _bank_uncertainty(recordings: Sequence[Recording], delta: FloatArray, bank: WaveformBank) -> float:
    """Leave-one-level-out error of a bank [rad]; refused where readings do not grow with the backlash."""
    inner = [k for k in range(len(recordings)) if bank.delta_rad[0] < delta[k] < bank.delta_rad[-1]]
    levels = {d: k for k, d in enumerate(bank.delta_rad.tolist())}
    found = np.array([match(recordings[k], bank.without(levels[delta[k]])).delta_rad for k in inner])
    by_level = [found[delta[inner] == d].mean() for d in np.unique(delta[inner])]
    if not (np.diff(by_level) > 0).all():
        raise ValueError(
            "method waveform: logs that the others predict do not come in the order of their backlashes; check the "
            "known backlashes, or use another method"
        )
    return _uncertainty(found - delta[inner])


def calibrate(
    recordings: Sequence[Recording],
    known_delta_rad: Sequence[float],
    method: str,
    provenance: str = "",
    repeats: int = 30,
    seed: int = 1,
) -> Calibration:
    """Calibrate a method on records of known backlash.

    Parameters
    ----------
    recordings : sequence of Recording
        Records of one joint in one movement.
    known_delta_rad : sequence of float
        Their backlashes [rad], six different ones or more.
    method : str
        One of `METHODS`.
    provenance : str
        What the records are.
    repeats, seed : int
        CMA-ES runs of "paper", and the seed of the first.

    Raises ------ ValueError Too few levels, several movements, no finite or negative backlash, or no monotonic
    relation.
    """
    delta = np.asarray(known_delta_rad, dtype=float)
    if delta.size != len(recordings) or not (np.isfinite(delta) & (delta >= 0)).all():
        raise ValueError("each log needs a known backlash, finite and not negative [rad]")
    if np.unique(delta).size < LEAST_LEVELS:
        raise ValueError(f"{np.unique(delta).size} different backlashes; a calibration needs {LEAST_LEVELS} or more")
    periods = np.array([recording.turn_period_s for recording in recordings])
    if np.ptp(periods) > PERIOD_MISMATCH * periods.mean():
        raise ValueError("the logs have different turn periods; calibrate one movement at a time")
    if method == "waveform":
        phases = min(_MOST_PHASES, *(samples_a_turn(recording) for recording in recordings))
        bank = make_bank(delta, [mean_turn(recording, phases) for recording in recordings])
        coefficients, uncertainty = (), _bank_uncertainty(recordings, delta, bank)
    else:
        bank = None
        value = np.array([read(recording, method, None, repeats, seed).value for recording in recordings])
        coefficients, uncertainty = fit_polynomial(value, delta, method)
    speed = float(np.mean([recording.commanded_speed_rps for recording in recordings]))
    return Calibration(
        method, coefficients, bank, (float(delta.min()), float(delta.max())), uncertainty, float(periods.mean()), speed,
        provenance,
    )  # fmt: skip


@lru_cache(maxsize=len(METHODS))
def default_calibration(method: str) -> Calibration:
    """Calibration of a method for the paper's joint, as `python -m replication calibrations` wrote it.

    That of "waveform", which is too large to be kept, is computed.
    """
    if method not in METHODS:
        raise ValueError(f"method {method!r}: there are {', '.join(METHODS)}")
    if method == "waveform":
        return compute_default(method)
    kept = json.loads(files("replication").joinpath(_KEPT).read_text(encoding="utf-8"))
    return Calibration.from_json(json.dumps(kept[method]), _KEPT)


def default_calibrations_text() -> str:
    """What `data/default_calibrations.json` is to hold."""
    kept = {name: compute_default(name).content() for name in METHODS if name != "waveform"}
    return json.dumps(kept, indent=1) + "\n"


def compute_default(method: str) -> Calibration:
    """Calibrate a method for the paper's joint.

    "paper" has equation 10 as printed, and the RMS error that it makes on simulated records; "amplitude" and "energy"
    are calibrated on simulated records of Table 2's range of backlash, "waveform" a little beyond it.
    """
    joint, levels = identified_joint(), printed_levels_rad()
    simulated = "the paper's joint as identified, simulated"
    if method == "waveform":
        deltas = np.round(np.arange(1e-4, levels[-1] + 4.5e-4, 1e-4), 6)
        records = simulate_recordings(joint, deltas, TURN_PERIOD_S / _MOST_PHASES, turns=3)
        return calibrate(records, deltas, method, simulated)
    fine = np.round(np.arange(levels[0], levels[-1] + 0.5e-4, 1e-4), 6)
    records = simulate_recordings(joint, fine)
    if method != "paper":
        return calibrate(records, fine, method, simulated)
    coefficients = equation_10().coefficients * RPM_PER_RPS ** np.arange(4)
    amplitude = np.array([read(record, "amplitude").value for record in records])
    return Calibration(
        method, tuple(coefficients.tolist()), None, (float(levels[0]), float(levels[-1])),
        _uncertainty(Polynomial(coefficients)(amplitude) - fine), TURN_PERIOD_S, COMMANDED_SPEED_RPS,
        f"equation 10 as printed; its error is that on {simulated}",
    )  # fmt: skip
