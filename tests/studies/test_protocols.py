import math
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from replication.files import FLOAT_FORMAT, ROOT
from replication.identify import Protocol, protocol_box
from replication.replay import protocols
from replication.replay.protocols import CANDIDATES, REALISATIONS, ROWS, RUNS
from replication.signature import rmse
from replication.table2 import AUTHORS
from workbook.execution import PINNED_ENVIRONMENT

NOTEBOOK = "authors' notebook"


def made_runs(names=(NOTEBOOK,), spread=0.03, sd_spread=1.0, seed=0, factor=1.0):
    """Summaries whose logs scatter normally about the printed numbers, or about a multiple of the means."""
    rng = np.random.default_rng(seed)
    mean, sd = protocols.PRINTED
    return pd.DataFrame(
        [
            {
                "protocol": name,
                "row": row,
                "realisation": realisation,
                "runs": 30,
                "mean_A_rps": factor * mean[row - 1] * math.exp(spread * rng.standard_normal()),
                "sd_A_rps": sd[row - 1] * math.exp(sd_spread * rng.standard_normal()),
                "best_basin_share": 0.9,
            }
            for name in names
            for row in ROWS
            for realisation in REALISATIONS
        ]
    )


def test_there_are_a_dozen_candidates_at_most_and_all_could_exist_before_2022():
    assert len(CANDIDATES) <= 12
    assert {candidate.protocol.engine for candidate in CANDIDATES.values()} == {"2021"}
    assert CANDIDATES[NOTEBOOK].protocol == Protocol()


def test_the_switched_off_line_has_all_that_its_comment_says():
    line = CANDIDATES["switched-off line"]
    assert (line.protocol.population, line.protocol.T_d, line.fixed_T2_s) == (2000, 0.204, 0.218)
    assert line.protocol.amplitude_factor == AUTHORS.amplitude_factor  # hence the same x0 and sigma0


def test_t_and_p_of_one_number_are_those_of_a_prediction_interval():
    numbers = np.exp(np.array([[0.1, 0.3, -0.2, 0.4, 0.0]]))
    t, _ = protocols.student_t(numbers, np.array([2.0]))
    logs = np.log(numbers[0])
    edge = logs.mean() + stats.t.ppf(0.975, 4) * logs.std(ddof=1) * math.sqrt(1.2)
    assert t[0] == pytest.approx((math.log(2) - logs.mean()) / (logs.std(ddof=1) * math.sqrt(1.2)))
    assert protocols.student_t(numbers, np.exp([edge]))[1][0] == pytest.approx(0.05)


def test_a_table_with_the_same_law_has_a_uniform_p():
    rng = np.random.default_rng(1)
    found = []
    for _ in range(300):
        tables = np.exp(0.03 * rng.standard_normal((2, 10, 6)))
        found.append(protocols.table_p(tables[..., :5], tables[..., 5])[0])
    assert stats.kstest(found, "uniform").pvalue > 0.01


def test_a_table_that_a_candidate_printed_is_explained_and_one_with_other_means_is_not():
    right, off = (protocols.judge(made_runs(factor=factor, seed=3)).iloc[0] for factor in (1.0, 1.2))
    assert right["explains"]
    assert right["means_outside"] <= 2
    assert not off["explains"]
    assert off["p_means"] < 0.001
    assert off["p_sds"] == right["p_sds"]


def test_a_realisation_that_lies_far_from_the_other_four_has_the_smallest_p_left_out():
    runs = made_runs(seed=4)
    runs.loc[runs["realisation"] == 2, "mean_A_rps"] *= 1.5
    left_out = protocols.leave_one_out(protocols.numbers_of(runs, NOTEBOOK))
    assert left_out[:, 2].argmin() == 1
    assert left_out[1, 2] < 0.001


@pytest.mark.parametrize(
    ("of_drawn", "of_whole", "holds"), [(0.3, 0.01, True), (0.01, 0.3, False), (0.3, 0.3, None), (0.01, 0.01, None)]
)
def test_the_start_is_decided_only_if_one_kind_of_start_alone_explains_the_table(of_drawn, of_whole, holds):
    starts = {"a": ("per run", of_drawn), "b": ("whole", of_whole), "c": ("whole", 0.001), "d": ("per record", 0.001)}
    judged = pd.DataFrame([{"protocol": name, "start": start, "p": p} for name, (start, p) in starts.items()])
    decided, text = protocols.random_start(judged)
    assert decided is holds
    assert "(a)" in text
    assert "(b)" in text


# --------------------------------------------------------------------------------------------------------------- runs


def test_a_run_in_rpm_ends_in_rps(authors_data):
    for name in (NOTEBOOK, "rpm about the mean"):
        A, misfit = protocols.one_run(CANDIDATES[name], 5, 1, 4)
        assert pytest.approx(0.68, abs=0.03) == A
        assert misfit == pytest.approx(0.09, abs=0.04)


def test_a_drawn_start_is_another_one_for_each_run_or_one_for_each_record(authors_data, monkeypatch):
    starts = []
    monkeypatch.setattr(protocols, "from_sample", lambda record, start: starts.append(start) or record)
    quick = replace(Protocol(), population=10, iterations=1)
    for start in ("whole", "per record", "per run"):
        candidate = replace(CANDIDATES[NOTEBOOK], protocol=replace(quick, start=start))
        for seed in range(1, 6):
            protocols.one_run(candidate, 3, 1, seed)
    assert set(starts[:5]) == {0}
    assert len(set(starts[5:10])) == 1
    assert len(set(starts[10:])) > 2


def test_the_run_without_bounds_goes_where_the_box_would_not_let_it_and_no_sample_is_bent(authors_data, monkeypatch):
    line = CANDIDATES["switched-off line, T_d = 0.2 s"]
    seen, plain = [], protocols.generations

    def watched(*arguments, **options):
        for now in plain(*arguments, **options):
            seen.append(now)
            yield now

    monkeypatch.setattr(protocols, "generations", watched)
    A, misfit = protocols.one_run(replace(line, protocol=replace(line.protocol, population=60)), 5, 1, 1)
    assert min(now.members[:, 1].min() for now in seen) < 0  # t0 below Table 1's bound
    assert all((now.x == now.members).all() for now in seen)
    best = min(seen, key=lambda now: now.misfits.min())
    member = best.members[best.ranking[0]]
    assert abs(member[0]) == A
    record = protocols._record(5, 1)
    X = np.r_[member, line.fixed_T2_s, 0.0]
    assert misfit == pytest.approx(rmse(record.t, record.v, X, line.protocol.timing), rel=1e-9)
    first = seen[0].before
    box = protocol_box(record, line.protocol)
    assert first.m == pytest.approx((box.lower + box.upper)[:5] / 2)  # x0 and sigma0 as in the box
    assert first.std == pytest.approx((box.upper - box.lower)[:5] / 4, rel=1e-3)


# -------------------------------------------------------------------------------------------------- the committed runs


def test_every_candidate_has_its_runs_on_every_row_and_realisation():
    runs = pd.read_csv(RUNS)
    assert runs.groupby("protocol", sort=False).size().to_dict() == dict.fromkeys(CANDIDATES, 50)
    for name, part in runs.groupby("protocol"):
        assert (part["runs"] == CANDIDATES[name].runs).all()


RUN_AGAIN = """
import sys
from backlash.studies.protocols import CANDIDATES, summarise
name, row, realisation = sys.argv[1:]
found = summarise(CANDIDATES[name], int(row), int(realisation))
print(found["mean_A_rps"], found["sd_A_rps"])
"""


@pytest.mark.slow
@pytest.mark.parametrize("number", np.random.default_rng(1).choice(600, size=3, replace=False))
def test_a_summary_drawn_from_the_committed_ones_comes_out_the_same_again(authors_data, number):
    kept = pd.read_csv(RUNS).iloc[number]
    drawn = [str(kept[name]) for name in ("protocol", "row", "realisation")]
    environment = os.environ | PINNED_ENVIRONMENT
    done = subprocess.run(
        [sys.executable, "-c", RUN_AGAIN, *drawn], env=environment, cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert [float(FLOAT_FORMAT % float(number)) for number in done.stdout.split()] == [*kept[list(protocols.COLUMNS)]]
