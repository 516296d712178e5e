"""A scoreboard of methods that read the backlash off a record: fixed logs of known backlash, and a score."""

import importlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pandas as pd
from numpy.polynomial import Polynomial
from scipy.optimize import differential_evolution, dual_annealing
from scipy.signal import butter, sosfiltfilt

from replication.characteristic import equation_10, printed_levels_rad
from replication.compiled.misfit import population_rmse
from replication.data.authors import DataUnavailable
from replication.datasets import Recording, add_uniform_noise, from_sample, level_delta_rad, load_noisy
from replication.identify import paper_fit, protocol_box
from replication.methods.calibration import default_calibration, fit_polynomial
from replication.methods.joint_match import match_joint
from replication.methods.readings import protocol_for, read
from replication.methods.self_calibration import fit_joint
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import identified_joint
from replication.studies.benchmark import AUTHORS_LOGS, JOINT_METHODS, Log, logs_by_methods, summarise_errors
from replication.studies.robustness import CHANGES

Method = Callable[[Recording], float]

SIMULATED_LOGS = 24  # of each kind

# What may have changed in "drifted" logs, by up to this share to either side.
DRIFTING = ("load mass", "stiffness", "speed gain", "integral gain", "torque lag")
DRIFT = 0.05

# Largest half-amplitude of the noise in simulated logs [rps], and the first samples that may be missing.
NOISE_RPS, LATEST_START = (0.1, 0.25), 100

SEED = 20
COLUMNS = ["method", "logs", "mean_abs_error_rad", "max_abs_error_rad", "rmse_rad", "seconds_per_log"]


class UnusableMethod(ValueError):
    """What was to be scored is no method; the message says why in one line."""

    exit_status = 2


def simulated_logs(drifted: bool) -> list[Log]:
    """Simulated logs with drawn backlash, noise and start; `drifted` ones are of joints that have changed."""
    rng = np.random.default_rng([SEED, int(drifted)])
    logs = []
    for _ in range(SIMULATED_LOGS):
        joint = identified_joint()
        for name in DRIFTING if drifted else ():
            joint = CHANGES[name](joint, rng.uniform(-DRIFT, DRIFT))
        delta = float(rng.uniform(*printed_levels_rad()[[0, -1]]))
        record = add_uniform_noise(simulate_recordings(joint, [delta])[0], rng.uniform(*NOISE_RPS), rng)
        record = from_sample(record, int(rng.integers(LATEST_START)))
        kind = {"kind": "drifted" if drifted else "simulated"}
        logs.append(Log(kind, delta, replace(record, source="a simulated log")))
    return logs


def scoreboard_logs() -> list[Log]:
    """All logs of the scoreboard, whose sources do not tell the backlash; errors as of `datasets.load_noisy`."""
    authors = [
        Log({"kind": "authors"}, level_delta_rad(level), replace(load_noisy(level, R), source="an authors' log"))
        for R, level in AUTHORS_LOGS
    ]
    return authors + simulated_logs(False) + simulated_logs(True)


def logs_at_hand() -> tuple[list[Log], str]:
    """Logs that can be had here, and what to say of those that cannot."""
    try:
        return scoreboard_logs(), ""
    except DataUnavailable as error:
        return simulated_logs(False) + simulated_logs(True), f"without the authors' logs: {error}"


# ---------------------------------------------------------------------------------------------------------------
# Methods


def _equation_10(amplitude_rps: float) -> float:
    return float(equation_10().backlash_rad(abs(amplitude_rps)))


def cma_es(recording: Recording) -> float:
    """Paper's sensor, one search: CMA-ES and equation 10."""
    return _equation_10(paper_fit(recording, protocol_for(recording), SEED).amplitude_rps)


def cma_es_30(recording: Recording) -> float:
    """Paper's sensor, the mean of 30 searches and equation 10."""
    return _equation_10(read(recording, "paper").value)


def _objective(recording: Recording) -> tuple[Callable, list[tuple[float, float]], int]:
    """Paper's objective for one parameter vector or columns of them, its box, and the evaluations of a CMA-ES run."""
    protocol = protocol_for(recording)
    box = protocol_box(recording, protocol)

    def rmse(x: np.ndarray) -> np.ndarray | float:
        misfits = population_rmse(recording.t, recording.v, np.atleast_2d(x.T), protocol.timing)
        return misfits if x.ndim > 1 else float(misfits[0])

    return rmse, list(zip(box.lower, box.upper, strict=True)), protocol.population * protocol.iterations


def scipy_differential_evolution(recording: Recording) -> float:
    """SciPy's differential evolution on the paper's objective, with as many evaluations, and equation 10."""
    rmse, bounds, evaluations = _objective(recording)
    members = 15 * len(bounds)
    ended = differential_evolution(
        rmse, bounds, maxiter=evaluations // members - 1, tol=0.0, polish=False, rng=np.random.default_rng(SEED),
        vectorized=True, updating="deferred",
    )  # fmt: skip
    return _equation_10(ended.x[0])


def scipy_dual_annealing(recording: Recording) -> float:
    """SciPy's dual annealing on the paper's objective, with as many evaluations, and equation 10."""
    rmse, bounds, evaluations = _objective(recording)
    ended = dual_annealing(rmse, bounds, maxiter=evaluations, maxfun=evaluations, rng=np.random.default_rng(SEED))
    return _equation_10(ended.x[0])


def _calibrated(method: str) -> Method:
    def measured(recording: Recording) -> float:
        calibration = default_calibration(method)
        return calibration.backlash(read(recording, method, calibration.bank)).delta_rad

    return measured


def _through_joint(free: Sequence[str]) -> Method:
    return lambda recording: match_joint(recording, identified_joint(), free).delta_rad


def peak_to_peak(recording: Recording) -> float:
    """Largest less least speed [rps], first turn left out."""
    return float(np.ptp(recording.v[recording.t >= recording.turn_period_s]))


def band_passed_rms(recording: Recording) -> float:
    """RMS of the speed between 10 and 40 Hz [rps], an octave to either side of the ring, first turn left out."""
    rate = (recording.t.size - 1) / (recording.t[-1] - recording.t[0])
    passed = sosfiltfilt(butter(4, (10.0, 40.0), "bandpass", fs=rate, output="sos"), recording.v - recording.v.mean())
    return float(np.sqrt(np.mean(passed[recording.t >= recording.turn_period_s] ** 2)))


@lru_cache
def _baseline_coefficients(value: Method) -> tuple[float, ...]:
    """Cubic of a plain value, fitted to simulated logs with noise in the middle of the scoreboard's range."""
    deltas = np.arange(3e-4, 21.5e-4, 1e-4)
    rng = np.random.default_rng([SEED, 2])
    logs = [add_uniform_noise(r, sum(NOISE_RPS) / 2, rng) for r in simulate_recordings(identified_joint(), deltas)]
    return fit_polynomial(np.array([value(log) for log in logs]), deltas, value.__name__)[0]


def _baseline(value: Method) -> Method:
    return lambda recording: float(Polynomial(_baseline_coefficients(value))(value(recording)))


# Every method of the table, the plainest first.
SCORED_METHODS: Mapping[str, Method] = {
    "peak to peak": _baseline(peak_to_peak),
    "band-passed RMS": _baseline(band_passed_rms),
    "CMA-ES, one run, equation 10": cma_es,
    "CMA-ES, mean of 30 runs, equation 10": cma_es_30,
    "differential evolution, equation 10": scipy_differential_evolution,
    "dual annealing, equation 10": scipy_dual_annealing,
    "global fit, amplitude": _calibrated("amplitude"),
    "global fit, energy": _calibrated("energy"),
    "waveform": _calibrated("waveform"),
    **{name: _through_joint(free) for name, free in JOINT_METHODS.items() if free},
    "self-calibration": lambda recording: fit_joint(recording).delta_rad,
}


# ---------------------------------------------------------------------------------------------------------------
# Scoring


def score_logs(name: str, method: Method, logs: Sequence[Log], jobs: int = 1) -> pd.DataFrame:
    """Errors and seconds of a method on logs; raise `UnusableMethod` if it fails or gives no finite number."""

    def answer(log: Log) -> dict[str, dict[str, float]]:
        where = f"{name}, log {log.labels['log']} ({log.recording.source})"
        begun = time.perf_counter()
        try:
            found = float(method(log.recording))
        except Exception as error:
            raise UnusableMethod(f"{where}: {type(error).__name__}: {' '.join(str(error).split())}") from error
        seconds = time.perf_counter() - begun
        if not np.isfinite(found):
            raise UnusableMethod(f"{where}: {found} is no backlash; return radians, finite")
        return {name: {"found_rad": found, "seconds": seconds}}

    numbered = [replace(log, labels={**log.labels, "log": number}) for number, log in enumerate(logs, start=1)]
    return logs_by_methods(numbered, answer, jobs)


def score_all(logs: Sequence[Log]) -> pd.DataFrame:
    """Score every method on logs, in parallel; rows as of `score_logs`."""
    scores = [score_logs(name, method, logs, jobs=-1) for name, method in SCORED_METHODS.items()]
    return pd.concat(scores, ignore_index=True)


def summary(scores: pd.DataFrame) -> pd.DataFrame:
    """Summarise scores by method: the columns of `results/scoreboard.csv`."""
    seconds = scores.groupby("method", sort=False)["seconds"].median()
    return summarise_errors(scores).assign(seconds_per_log=seconds.to_numpy())[COLUMNS]


def load_method(name: str) -> Method:
    """Import a method by `module:function`, or raise `UnusableMethod`."""
    module, colon, function = name.partition(":")
    if not (module and colon and function):
        raise UnusableMethod(f"{name!r}: name the method as module:function")
    try:
        method = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise UnusableMethod(f"{name}: {error}; is it on the Python path?") from error
    if not callable(method):
        raise UnusableMethod(f"{name}: not a function of a Recording that returns radians")
    return method
