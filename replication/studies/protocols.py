"""Which protocol printed Table 2? Candidates, their pools of runs, and how likely each makes the printed table.

The criteria, written down before any pool was computed:

- Summary of a row: mean and SD of |A| over 30 runs. Strays, runs outside the best basin (`table2.basin_labels`), are
  counted too, but nothing of them is printed.
- Predictive distribution: a row's realisation is drawn among R = 1 and 2, its pool is resampled (the pool is finite),
  and 30 runs are drawn from that. Rows are independent: each has its own noise.
- Likelihood of a row: a Gaussian kernel in ln mean and ln SD around each of `DRAWS` draws. Its width along ln mean is
  how far the realisations R = 1 and R = 2 are apart in the best basin's A (rms over the rows; the printed realisation is
  unknown, and this is how far it is from ours). Along ln SD it is how far they are apart in the best basin's SD, but not
  less than 0.13, what an SD of 30 normal runs leaves open. Both are derived once, from the pool of the authors' notebook.
- With a probability of `OTHER` a row's numbers come from something else, evenly spread over ±10 % of the theoretical A
  (the text's limit) and, in ln SD, from 0.0003 to 0.3 rps. So no single row decides alone.
- Prior: every candidate is as probable as any other.
- Dropping: a candidate whose log-likelihood after `SCREENED` runs a row is more than `DROPPED_BELOW` below the best gets
  no more runs. Half of it bounds what few runs can do: a row's log-likelihood has a range of about 9, and its error at
  20 + 20 runs is 1 at most; ten rows make 3; 20 is six of those, and a share of exp(-20).
- A region: the middle 95 % of a row's predictive means, or SDs, in another realisation.
- The table's p-value: the share of predicted tables whose log-likelihood is no higher than the printed table's.
- A region that holds at least half of the other nine printed numbers of its column decides nothing
  (`workbook.judging`).
- Choice: five rows choose the candidate, the other five judge it; odd rows for even ones and conversely, and all 252
  choices of five.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from numpy.typing import NDArray

from replication import published
from replication.compiled.folded import fold
from replication.compiled.misfit import population_rmse
from replication.compiled.whole_run import whole_run
from replication.datasets import Recording, from_sample
from replication.identify import Protocol, protocol_box
from replication.search import generations, random_normals, search
from replication.signature import Box, Timing
from replication.table2 import BASIN_GAP, basin_labels, start_samples

FloatArray = NDArray[np.float64]

RUNS = 30  # of a printed row
DRAWS = 4000
OTHER = 0.01
OTHER_MEAN = 0.1  # half-width, relative to the theoretical A
OTHER_SD_RPS = (0.0003, 0.3)
LEAST_SD_WIDTH = 0.13
SCREENED = 40  # runs a row, half on R = 1, half on R = 2
CONTENDER = 200
DROPPED_BELOW = 20.0

RPS, RPM = "rps", "rpm about the mean"
PRINTED_T_S = (published.value("table1.T_d.max"), published.value("table1.T_f.max"))
# T_d and T_f are free within this share of the data's; no bounds are printed.
FREE_SHARE = 0.1
SEED_STEP = 10_000  # between a run's restarts


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
    """

    name: str
    protocol: Protocol
    unit: str = RPS
    restarts: int = 0
    free_timing: bool = False
    positive: bool = False


def default_iterations(population: int, n: int = 7) -> int:
    """The most generations that the library allows if nothing is said."""
    return int(100 + 150 * (n + 3) ** 2 / population**0.5)


NO_LIMIT = 0  # iterations: the library's default for each population


def _around(pole: str, unit: str, factor: float) -> list[Candidate]:
    """Candidates that differ from a pole in one respect, or in two that go together."""
    base = Protocol(amplitude_factor=factor)
    other = 1.0 if factor != 1.0 else 1.3
    large = [
        (f"population {size}{text}", Candidate("", replace(base, population=size, iterations=limit), unit))
        for size in (150, 300, 600, 1000, 2000)
        for limit, text in ((200, ""), (NO_LIMIT, ", no limit"))
        if (size, limit) != (300, 200)
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
        ("box of A " + ("as printed" if other == 1.0 else "1.3"), Candidate("", replace(base, amplitude_factor=other), unit)),
        ("T_d and T_f printed", Candidate("", replace(base, T_d=PRINTED_T_S[0], T_f=PRINTED_T_S[1]), unit)),
        ("T_d and T_f free", Candidate("", base, unit, free_timing=True)),
        ("A positive", Candidate("", base, unit, positive=True)),
    ]
    return [
        replace(candidate, name=f"{pole}, {text}" if text else pole)
        for text, candidate in (*others, *large, *starts, *restarted)
    ]


AUTHORS, PAPER = "authors' notebook", "rpm"
GRID = {c.name: c for c in (*_around(AUTHORS, RPS, 1.3), *_around(PAPER, RPM, 1.0))}
