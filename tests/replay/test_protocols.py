import math
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from replication import identify, published
from replication.authors import LOW_NOISE
from replication.files import FLOAT_FORMAT, ROOT
from replication.identify import paper_fit, protocol_box
from replication.processors import pinned_environment
from replication.replay import protocols
from replication.replay.protocols import CANDIDATES, PROTOCOL_RUNS, ROWS, VARIANTS
from replication.signature import rmse
from replication.table2 import AUTHORS_PROTOCOL

NOTEBOOK = AUTHORS_PROTOCOL.name


def made_runs(seed, factor=1.0):
    """Summaries of the notebook's protocol that scatter about the printed numbers, or a multiple of the means."""
    rng = np.random.default_rng(seed)
    runs = pd.DataFrame(
        [(row, R) for row in ROWS for R in LOW_NOISE], columns=["row", "realisation"]
    )
    mean, sd = protocols.PRINTED[:, runs["row"] - 1]
    return runs.assign(
        protocol=NOTEBOOK,
        runs=30,
        mean_A_rps=factor * mean * np.exp(0.03 * rng.standard_normal(len(runs))),
        sd_A_rps=sd * np.exp(rng.standard_normal(len(runs))),
        best_basin_share=0.9,
    )


def test_there_are_a_dozen_candidates_at_most_and_all_could_exist_before_2022():
    assert len(CANDIDATES) <= 12
    assert {name for name in VARIANTS if name not in CANDIDATES} == {"today's cma"}
    assert CANDIDATES[NOTEBOOK] == identify.Protocol()
    as_printed = CANDIDATES["T_d and T_f as printed"]
    assert as_printed.T_d == published.value("table1.T_d.max")
    assert as_printed.T_f == published.value("table1.T_f.max")


def test_the_switched_off_line_has_all_that_its_comment_says():
    line = CANDIDATES["switched-off line"]
    assert (line.population, line.T_d, line.fixed_T2_s) == (2000, 0.204, 0.218)
    assert (
        line.amplitude_factor == AUTHORS_PROTOCOL.amplitude_factor
    )  # hence the same x0 and sigma0


def test_t_and_p_of_one_number_are_those_of_a_prediction_interval():
    logs = np.array([0.1, 0.3, -0.2, 0.4, 0.0])
    numbers, sd = np.exp(logs[None]), logs.std(ddof=1) * math.sqrt(1.2)
    assert protocols.student_t(numbers, np.array([2.0]))[0] == pytest.approx(
        (math.log(2) - logs.mean()) / sd
    )
    edge = logs.mean() + stats.t.ppf(0.975, 4) * sd
    assert protocols.student_t(numbers, np.exp([edge]))[1] == pytest.approx(0.05)


def test_a_table_with_the_same_law_has_a_uniform_p():
    tables = np.exp(0.03 * np.random.default_rng(1).standard_normal((300, 2, 10, 6)))
    found = [protocols.table_p(table[..., :5], table[..., 5])[0] for table in tables]
    assert stats.kstest(found, "uniform").pvalue > 0.01


def test_a_table_that_a_candidate_printed_is_explained_and_one_with_other_means_is_not():
    right, off = (protocols.judge(made_runs(3, factor)).iloc[0] for factor in (1.0, 1.2))
    assert right["explains"]
    assert right["means_outside"] <= 2
    assert not off["explains"]
    assert off["p_means"] < 0.001
    assert off["p_sds"] == right["p_sds"]


def test_a_realisation_that_lies_far_from_the_other_four_has_the_smallest_p_left_out():
    runs = made_runs(4)
    runs.loc[runs["realisation"] == 2, "mean_A_rps"] *= 1.5
    p = protocols.leave_one_out(protocols.numbers_of(runs, NOTEBOOK))[:, 2]
    assert p.argmin() == 1
    assert p[1] < 0.001


@pytest.mark.parametrize(
    ("of_drawn", "of_whole", "holds"),
    [(0.3, 0.01, True), (0.01, 0.3, False), (0.3, 0.3, None), (0.01, 0.01, None)],
)
def test_the_start_is_decided_only_if_one_kind_of_start_alone_explains_the_table(
    of_drawn, of_whole, holds
):
    start, p = ["per run", "whole", "whole", "per record"], [of_drawn, of_whole, 0.001, 0.001]
    decided, text = protocols.random_start(
        pd.DataFrame({"protocol": list("abcd"), "start": start, "p": p})
    )
    assert decided is holds
    assert "(a)" in text
    assert "(b)" in text


# --------------------------------------------------------------------------------------------------------------- runs


def test_a_run_in_rpm_ends_in_rps(authors_data):
    record = protocols._record(5, 1)
    for name in (NOTEBOOK, "rpm about the mean"):
        fit = protocols.one_run(CANDIDATES[name], 5, 1, 4)
        assert fit.amplitude_rps == pytest.approx(0.68, abs=0.03)
        assert fit.rmse == pytest.approx(0.09, abs=0.04)
        assert fit.rmse == pytest.approx(
            rmse(record.t, record.v, fit.X, CANDIDATES[name].timing), rel=1e-9
        )


def test_a_drawn_start_is_another_one_for_each_run_or_one_for_each_record(
    authors_data, monkeypatch
):
    starts = []
    monkeypatch.setattr(
        protocols, "from_sample", lambda record, start: starts.append(start) or record
    )
    for start in ("whole", "per record", "per run"):
        quick = replace(AUTHORS_PROTOCOL, population=10, iterations=1, start=start)
        for seed in range(1, 6):
            protocols.one_run(quick, 3, 1, seed)
    assert set(starts[:5]) == {0}
    assert len(set(starts[5:10])) == 1
    assert len(set(starts[10:])) > 2


def test_the_run_without_bounds_goes_where_the_box_would_not_let_it_and_no_sample_is_bent(
    authors_data, monkeypatch
):
    line = replace(CANDIDATES["switched-off line, T_d = 0.2 s"], population=60)
    seen, plain = [], identify.generations

    def watched(*arguments, **options):
        for now in plain(*arguments, **options):
            seen.append(now)
            yield now

    monkeypatch.setattr(identify, "generations", watched)
    record = protocols._record(5, 1)
    fit = paper_fit(record, line, 1)
    assert min(now.members[:, 1].min() for now in seen) < 0  # t0 below Table 1's bound
    assert all((now.x == now.members).all() for now in seen)
    assert fit.X[5:].tolist() == [line.fixed_T2_s, 0.0]
    assert fit.rmse == pytest.approx(rmse(record.t, record.v, fit.X, line.timing), rel=1e-9)
    first = seen[0].before
    box = protocol_box(record, line)
    assert first.m == pytest.approx((box.lower + box.upper)[:5] / 2)  # x0 and sigma0 as in the box
    assert first.std == pytest.approx((box.upper - box.lower)[:5] / 4, rel=1e-3)


# -------------------------------------------------------------------------------------------------- the committed runs


def test_every_candidate_has_its_runs_on_every_row_and_realisation():
    parts = dict(list(pd.read_csv(PROTOCOL_RUNS).groupby("protocol", sort=False)))
    assert list(parts) == list(CANDIDATES)
    for name, part in parts.items():
        assert part["runs"].tolist() == [protocols.runs_of(CANDIDATES[name])] * 50


RUN_AGAIN = """
import sys
from replication.replay.protocols import CANDIDATES, summarise
name, row, realisation = sys.argv[1:]
found = summarise(CANDIDATES[name], int(row), int(realisation))
print(found["mean_A_rps"], found["sd_A_rps"])
"""


@pytest.mark.slow
@pytest.mark.parametrize("number", np.random.default_rng(1).choice(600, size=3, replace=False))
def test_a_summary_drawn_from_the_committed_ones_comes_out_the_same_again(authors_data, number):
    kept = pd.read_csv(PROTOCOL_RUNS).iloc[number]
    command = [
        sys.executable,
        "-c",
        RUN_AGAIN,
        *kept[["protocol", "row", "realisation"]].astype(str),
    ]
    environment = os.environ | pinned_environment()
    done = subprocess.run(
        command, env=environment, cwd=ROOT, capture_output=True, text=True, check=True
    )
    again = [float(FLOAT_FORMAT % float(number)) for number in done.stdout.split()]
    assert again == kept[list(protocols.COLUMNS)].tolist()
