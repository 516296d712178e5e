"""A scoreboard of methods that read the backlash off a record: fixed logs of known backlash, and a score."""

import pkgutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import pandas as pd
from numpy.polynomial import Polynomial
from scipy.optimize import differential_evolution, dual_annealing
from scipy.signal import butter, sosfiltfilt

from backlash.calibration import default_calibration, fit_polynomial
from backlash.fitting.joint_match import match_joint
from backlash.fitting.readings import protocol_for, read
from backlash.fitting.self_calibration import fit_joint
from backlash.studies import benchmark
from backlash.studies.accuracy import CALIBRATED_RAD, CHANGES
from backlash.studies.benchmark import AUTHORS_LOGS, JOINT_METHODS, Log, calibrated_answers, logs_by_methods
from backlash.studies.optimizers import Cost
from replication.characteristic import equation_10, printed_levels_rad
from replication.datasets import Recording, add_uniform_noise, from_sample, level_delta_rad, load_noisy
from replication.identify import paper_fit
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import identified_joint

Method = Callable[[Recording], float]

SIMULATED_LOGS = 24  # of each kind
# What may have changed in "drifted" logs, by up to this share to either side.
DRIFTING, DRIFT = ("load mass", "stiffness", "speed gain", "integral gain", "torque lag"), 0.05
# Largest half-amplitude of the noise in simulated logs [rps], and the first samples that may be missing.
NOISE_RPS, LATEST_START = (0.1, 0.25), 100

SEED = 20
COLUMNS = ["method", "logs", "mean_abs_error_rad", "max_abs_error_rad", "rmse_rad", "seconds_per_log"]


class UnusableMethod(ValueError):
    """What was to be scored is no method; the message says why in one line."""

    exit_status = 2


def simulated_logs(drifted: bool) -> list[Log]:
    """Logs with drawn backlash, which their source does not tell, noise and start; `drifted` ones of changed joints."""
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


def authors_logs() -> list[Log]:
    """The authors' noisy logs; errors as of `datasets.load_noisy`."""
    return [
        Log({"kind": "authors"}, level_delta_rad(level), replace(load_noisy(level, R), source="an authors' log"))
        for R, level in AUTHORS_LOGS
    ]


def _equation_10(amplitude_rps: float) -> float:
    return float(equation_10().backlash_rad(abs(amplitude_rps)))


def _objective(recording: Recording) -> tuple[Cost, list[tuple[float, float]], int]:
    """Paper's objective, its box, and the evaluations of a CMA-ES run."""
    protocol = protocol_for(recording)
    cost = Cost(recording, -np.inf, sys.maxsize, protocol)
    return cost, list(zip(cost.box.lower, cost.box.upper, strict=True)), protocol.population * protocol.iterations


def scipy_differential_evolution(recording: Recording) -> float:
    """SciPy's differential evolution on the paper's objective, with as many evaluations, and equation 10."""
    cost, bounds, evaluations = _objective(recording)
    settings = {"tol": 0.0, "polish": False, "vectorized": True, "updating": "deferred"}
    generations, rng = evaluations // (15 * len(bounds)) - 1, np.random.default_rng(SEED)
    ended = differential_evolution(lambda x: cost.of_members(x.T), bounds, maxiter=generations, rng=rng, **settings)
    return _equation_10(ended.x[0])


def scipy_dual_annealing(recording: Recording) -> float:
    """SciPy's dual annealing on the paper's objective, with as many evaluations, and equation 10."""
    cost, bounds, evaluations = _objective(recording)
    settings = {"maxiter": evaluations, "maxfun": evaluations, "rng": np.random.default_rng(SEED)}
    return _equation_10(dual_annealing(lambda x: float(cost.of_members(x[None])[0]), bounds, **settings).x[0])


def _calibrated(method: str, recording: Recording) -> float:
    return calibrated_answers(recording, {method: default_calibration(method)})[method]


def _by_joint(method: str, recording: Recording) -> float:
    return match_joint(recording, identified_joint(), JOINT_METHODS[method])["delta_rad"]


def peak_to_peak(recording: Recording) -> float:
    """Largest less least speed [rps], first turn left out."""
    return float(np.ptp(recording.v[recording.t >= recording.turn_period_s]))


def band_passed_rms(recording: Recording) -> float:
    """RMS of the speed between 10 and 40 Hz [rps], an octave to either side of the ring, first turn left out."""
    rate = (recording.t.size - 1) / (recording.t[-1] - recording.t[0])
    passed = sosfiltfilt(butter(4, (10.0, 40.0), "bandpass", fs=rate, output="sos"), recording.v - recording.v.mean())
    return float(np.sqrt(np.mean(passed[recording.t >= recording.turn_period_s] ** 2)))


@lru_cache
def _baseline_cubic(value: Method) -> Polynomial:
    """Cubic of a plain value, fitted to simulated logs with noise in the middle of the scoreboard's range."""
    rng, clean = np.random.default_rng([SEED, 2]), simulate_recordings(identified_joint(), CALIBRATED_RAD)
    values = [value(add_uniform_noise(record, sum(NOISE_RPS) / 2, rng)) for record in clean]
    return Polynomial(fit_polynomial(np.array(values), np.array(CALIBRATED_RAD), value.__name__)[0])


def _baseline(value: Method, recording: Recording) -> float:
    return float(_baseline_cubic(value)(value(recording)))


# Every method of the table, the plainest first.
SCORED_METHODS: Mapping[str, Method] = {
    "peak to peak": partial(_baseline, peak_to_peak),
    "band-passed RMS": partial(_baseline, band_passed_rms),
    "CMA-ES, one run, equation 10": lambda log: _equation_10(paper_fit(log, protocol_for(log), SEED).amplitude_rps),
    "CMA-ES, mean of 30 runs, equation 10": lambda log: _equation_10(read(log, "paper").value),
    "differential evolution, equation 10": scipy_differential_evolution,
    "dual annealing, equation 10": scipy_dual_annealing,
    "global fit, amplitude": partial(_calibrated, "amplitude"),
    "global fit, energy": partial(_calibrated, "energy"),
    "waveform": partial(_calibrated, "waveform"),
    **{method: partial(_by_joint, method) for method, free in JOINT_METHODS.items() if free},
    "self-calibration": lambda log: fit_joint(log).delta_rad,
}


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


def score_all() -> pd.DataFrame:
    """Score every method on the scoreboard's logs, in parallel; rows as of `score_logs`."""
    logs = authors_logs() + simulated_logs(False) + simulated_logs(True)
    return pd.concat([score_logs(name, method, logs, -1) for name, method in SCORED_METHODS.items()], ignore_index=True)


def summary(scores: pd.DataFrame) -> pd.DataFrame:
    """Summarise scores by method: the columns of `results/scoreboard.csv`."""
    seconds = scores.groupby("method", sort=False)["seconds"].median()
    return benchmark.summarise_errors(scores).assign(seconds_per_log=seconds.to_numpy())[COLUMNS]


def load_method(name: str) -> Method:
    """Import a method by `module:function`, or raise `UnusableMethod`."""
    try:
        method = pkgutil.resolve_name(name)
    except (ValueError, ImportError, AttributeError) as error:
        raise UnusableMethod(f"{name}: {error}; name a module:function on the Python path") from error
    if not callable(method):
        raise UnusableMethod(f"{name}: not a function of a Recording that returns radians")
    return method
