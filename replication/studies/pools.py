"""Protocols that may have printed Table 2, as data, and their pools of runs."""

import gzip
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from numpy.typing import NDArray

from replication import published
from replication.compiled.bounds import Margin, margin_2021, margin_today
from replication.compiled.folded import fold
from replication.compiled.misfit import population_rmse
from replication.compiled.whole_run import whole_run
from replication.datasets import Recording, add_uniform_noise, from_sample, load_noisy
from replication.identify import Protocol, protocol_box
from replication.search import generations, random_normals, search
from replication.signature import Box, Timing
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import identified_joint
from replication.table2 import noise_only_record, simulated_table2_records, table2_levels
from replication.workbook.files import ROOT, write_bytes

FloatArray = NDArray[np.float64]

ROWS = range(1, 11)
STARTS = ("whole", "per record", "per run")
BLOCK = 10  # runs that share a start which is drawn once for a record: a block stands for another draw
RPS, RPM = "rps", "rpm about the mean"
PRINTED_T_S = (published.value("table1.T_d.max"), published.value("table1.T_f.max"))
FREE_SHARE = 0.1  # T_d and T_f are free within this share of the data's; no bounds are printed
SEED_STEP = 10_000  # between a run's restarts
# Stand-ins for Table 3's states: half-amplitude of the noise [rps], Coulomb friction on the load over m g r.
BENCHES = [(noise, friction) for friction in (0.0, 0.05) for noise in (0.03, 0.07, 0.14, 0.28)]
BENCH_DELTAS_RAD = (9e-4, 10e-4, 11e-4)
FOLDER = ROOT / "results" / "protocols"
COLUMNS = ["record", "row", "seed", "A_rps", "omega_rad_per_s", "rmse_rps"]


@dataclass(frozen=True)
class Candidate:
    """A protocol that may have printed Table 2.

    Attributes
    ----------
    name : str
        What tables call it.
    protocol : Protocol
        Population, iterations, box of A, T_d and T_f, start.
    unit : str
        `RPS`, the record as it is; or `RPM`, 60 (v - mean v), as equation 10 has A.
    restarts : int
        How often a run starts again with twice the population, and keeps its best end.
    free_timing : bool
        T_d and T_f are searched too.
    positive : bool
        The box of A begins at 0.
    margin : callable
        Width of the margin at a bound.
    """

    name: str
    protocol: Protocol
    unit: str = RPS
    restarts: int = 0
    free_timing: bool = False
    positive: bool = False
    margin: Margin = margin_2021


def default_iterations(population: int, n: int = 7) -> int:
    """The most generations that the library allows if nothing is said."""
    return int(100 + 150 * (n + 3) ** 2 / population**0.5)


NO_LIMIT = 0  # iterations: the library's default for each population


def _around(pole: str, unit: str, factor: float) -> list[Candidate]:
    """Candidates that differ from a pole in one respect, or in two that go together."""
    base = Protocol(amplitude_factor=factor)
    other = 1.0 if factor != 1.0 else 1.3
    # From 600 on no limit is tried: a run there hardly needs 200 generations.
    large = [
        (f"population {size}{text}", Candidate("", replace(base, population=size, iterations=limit), unit))
        for size, limit, text in (
            *((size, 200, "") for size in (150, 600, 1000, 2000)),
            *((size, NO_LIMIT, ", no limit") for size in (150, 300)),
        )
    ]
    starts = [
        (f"start {start}, population {size}", Candidate("", replace(base, population=size, start=start), unit))
        for start in ("per record", "per run")
        for size in (300, 1000, 2000)
    ]
    restarted = [
        (f"{size} and {n} restarts", Candidate("", replace(base, population=size, iterations=NO_LIMIT), unit, n))
        for size, n in ((9, 4), (9, 5), (9, 6), (9, 7), (150, 1), (150, 2), (300, 1), (300, 2))
    ]
    others = [
        ("", Candidate("", base, unit)),
        (
            "box of A " + ("as printed" if other == 1.0 else "1.3"),
            Candidate("", replace(base, amplitude_factor=other), unit),
        ),
        ("T_d and T_f printed", Candidate("", replace(base, T_d=PRINTED_T_S[0], T_f=PRINTED_T_S[1]), unit)),
        ("T_d and T_f free", Candidate("", base, unit, free_timing=True)),
        ("A positive", Candidate("", base, unit, positive=True)),
        ("margins of cma 4", Candidate("", base, unit, margin=margin_today)),
    ]
    return [
        replace(candidate, name=f"{pole}, {text}" if text else pole)
        for text, candidate in (*others, *large, *starts, *restarted)
    ]


AUTHORS, PAPER = "authors' notebook", "rpm"
GRID = {c.name: c for c in (*_around(AUTHORS, RPS, 1.3), *_around(PAPER, RPM, 1.0))}


def file_of(name: str, folder: Path = FOLDER) -> Path:
    """File that keeps a candidate's pool."""
    kept = "".join(letter if letter.isalnum() else " " for letter in name.replace("'", "").lower())
    return folder / f"{'_'.join(kept.split())}.csv.gz"


def pool(name: str, folder: Path = FOLDER) -> pd.DataFrame:
    """Load a candidate's runs.

    Returns
    -------
    DataFrame
        `COLUMNS`. A record "R1" is the authors' realisation 1, "S3" our joint with the third noise, "N5" noise alone,
        and "B2" a bench of `BENCHES`.
    """
    path = file_of(name, folder)
    return pd.read_csv(path) if path.exists() else pd.DataFrame(columns=COLUMNS)


@cache
def records(label: str) -> dict[int, Recording]:
    """The records that a pool calls by a label, as in `pool`, by row of Table 2, or of Table 3 for a bench."""
    kind, number = label[0], int(label[1:])
    if kind == "R":
        return {row: load_noisy(level, number) for row, level in zip(ROWS, table2_levels(), strict=True)}
    if kind == "B":
        return dict(enumerate(bench_records(number), start=1))
    found = simulated_table2_records(identified_joint(), number) if kind == "S" else [noise_only_record(number)]
    return {key["row"]: recording for key, recording in found}


def bench_records(number: int) -> list[Recording]:
    """Simulate the three states of Table 3's bench with the noise and the friction of `BENCHES[number]`."""
    noise_rps, friction = BENCHES[number]
    joint, rng = identified_joint(), np.random.default_rng(number)
    joint = replace(joint, load_coulomb_nm=friction * joint.gravity_torque_nm)
    return [add_uniform_noise(record, noise_rps, rng) for record in simulate_recordings(joint, BENCH_DELTAS_RAD)]


def one_run(candidate: Candidate, recording: Recording, row: int, seed: int) -> tuple[float, float, float]:
    """Fit a record of Table 2 once.

    Parameters
    ----------
    candidate : Candidate
        The protocol.
    recording : Recording
        The whole record [rps].
    row : int
        Row of Table 2, which the draw of the start depends on.
    seed : int
        Seed of the run, above 0.

    Returns
    -------
    tuple of float
        A [rps], with its sign, omega [rad/s] and RMSE [rps].
    """
    protocol = candidate.protocol
    record = from_sample(recording, _start(protocol, row, seed))
    scale = 1.0 if candidate.unit == RPS else 60.0
    if candidate.unit == RPM:
        record = replace(record, v=scale * (record.v - record.v.mean()))
    box = protocol_box(record, protocol)
    if candidate.positive:
        box = Box(np.r_[0.0, box.lower[1:]], box.upper)
    best, misfit = np.empty(0), math.inf
    for restart in range(candidate.restarts + 1):
        population = protocol.population * 2**restart
        iterations = protocol.iterations or default_iterations(population)
        settings = seed + SEED_STEP * restart, population, iterations
        if candidate.free_timing:
            found = _free_run(record, box, protocol.timing, *settings)
        else:
            run = whole_run(fold(record.t, record.v, protocol.timing), box, *settings, candidate.margin)
            found = run.best, run.misfit
        if found[1] < misfit:
            best, misfit = found
    return float(best[0] / scale), float(best[3]), float(misfit / scale)


def _start(protocol: Protocol, row: int, seed: int) -> int:
    if protocol.start == "whole":
        return 0
    key = (row, (seed - 1) // BLOCK) if protocol.start == "per record" else (row, seed)
    return int(np.random.default_rng(key).integers(protocol.latest_start))


def _free_run(record, box, timing, seed, population, iterations) -> tuple[FloatArray, float]:
    middle = np.array([timing.T_d, timing.T_f])
    wide = Box(np.r_[box.lower, (1 - FREE_SHARE) * middle], np.r_[box.upper, (1 + FREE_SHARE) * middle])

    def misfits(members: FloatArray) -> FloatArray:
        each = [population_rmse(record.t, record.v, X[None, :7], Timing(X[7], X[8], timing.n)) for X in members]
        return np.concatenate(each)

    found = search(generations(misfits, wide, random_normals(seed), population), iterations)
    return found.best, found.misfit


def extend_pool(
    candidate: Candidate, labels: Sequence[str], runs: int, folder: Path = FOLDER, jobs: int = 2
) -> pd.DataFrame:
    """Compute what a candidate's pool lacks of the seeds 1 to `runs` on some records, and keep it.

    Parameters
    ----------
    candidate : Candidate
        The protocol.
    labels : sequence of str
        Records, as in `pool`.
    runs : int
        Runs on each record.
    folder : Path
        Where pools are kept.
    jobs : int
        Processes.

    Returns
    -------
    DataFrame
        The pool, as `pool` loads it.
    """
    known = pool(candidate.name, folder)
    have = set(zip(known["record"], known["row"], known["seed"], strict=True))
    todo = [
        (label, row, recording, [seed for seed in range(1, runs + 1) if (label, row, seed) not in have])
        for label in labels
        for row, recording in records(label).items()
    ]
    todo = [part for part in todo if part[3]]
    found = Parallel(n_jobs=jobs)(delayed(_runs)(candidate, *part) for part in todo)
    if todo:
        new = pd.DataFrame([row for part in found for row in part], columns=COLUMNS)
        table = pd.concat([known, new], ignore_index=True) if len(known) else new
        table = table.sort_values(["record", "row", "seed"], kind="stable", ignore_index=True)
        text = table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
        write_bytes(file_of(candidate.name, folder), gzip.compress(text.encode(), mtime=0))
    return pool(candidate.name, folder)


def _runs(candidate: Candidate, label: str, row: int, recording: Recording, seeds: list[int]) -> list[tuple]:
    return [(label, row, seed, *one_run(candidate, recording, row, seed)) for seed in seeds]


def realisations(runs: pd.DataFrame, row: int, candidate: Candidate, kind: str = "R") -> list[FloatArray]:
    """|A| [rps] of a row's runs, one array for each realisation, or for each draw of a start made once for a record.

    Parameters
    ----------
    runs : DataFrame
        A pool.
    row : int
        Row of Table 2.
    candidate : Candidate
        Whose pool it is.
    kind : str
        What the records' labels begin with; on noise alone, "N", A keeps its sign.
    """
    part = runs[(runs["row"] == row) & runs["record"].str.startswith(kind)]
    block = (part["seed"] - 1) // BLOCK * (candidate.protocol.start == "per record")
    found = [one["A_rps"].to_numpy() for _, one in part.groupby([part["record"], block])]
    return found if kind == "N" else [np.abs(A) for A in found]
