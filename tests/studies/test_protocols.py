import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from replication import published
from replication.compiled.misfit import population_rmse
from replication.identify import Protocol
from replication.studies import pools, predictive, protocols
from replication.studies.pools import AUTHORS, GRID, PAPER, ROWS

WIDTH = (0.01, 0.3)


def made_pool(mean=0.7, stray=0.0, records=("R1", "R2"), seed=0, rows=ROWS, runs=100):
    """A pool whose runs end at the mean, 0.2 % apart, or at 0.8 times of it."""
    rng, parts = np.random.default_rng(seed), []
    for record in records:
        for row in rows:
            away = rng.random(runs) < stray
            A = mean * np.where(away, 0.8, 1.0) * (1 + 0.002 * rng.standard_normal(runs)) * rng.choice([-1, 1], runs)
            parts.append(
                pd.DataFrame(
                    {"record": record, "row": row, "seed": range(1, runs + 1), "A_rps": A}
                    | {"omega_rad_per_s": 134.0, "rmse_rps": np.where(away, 0.12, 0.09)}
                )
            )
    return pd.concat(parts, ignore_index=True)


def test_every_candidate_has_a_name_and_a_file_of_its_own():
    assert len({pools.file_of(name).name for name in GRID}) == len(GRID)
    assert GRID[AUTHORS].protocol == Protocol()
    assert (GRID[PAPER].protocol.amplitude_factor, GRID[PAPER].unit) == (1.0, pools.RPM)


def test_the_candidates_cover_what_the_paper_leaves_open():
    of = [candidate.protocol for candidate in GRID.values()]
    assert {protocol.population for protocol in of} == {9, 150, 300, 600, 1000, 2000}
    assert {protocol.start for protocol in of} == set(pools.STARTS)
    assert {protocol.amplitude_factor for protocol in of} == {1.0, 1.3}
    assert {protocol.T_d for protocol in of} == {0.2, published.value("table1.T_d.max")}
    assert any(candidate.restarts for candidate in GRID.values())


def test_the_default_number_of_generations_is_the_librarys():
    assert pools.default_iterations(300) == 966
    assert pools.default_iterations(9) == 5100


@pytest.fixture(scope="module")
def record(authors_data):
    return pools.records("R1")[5]


def test_a_run_has_the_misfit_of_its_end_in_rps_whatever_the_unit(record):
    for name in (AUTHORS, PAPER):
        A, omega, rmse = pools.one_run(GRID[name], record, 5, 1)
        assert abs(A) == pytest.approx(0.68, abs=0.03)
        assert rmse == pytest.approx(0.09, abs=0.03)
        assert omega == pytest.approx(134.5, abs=5)


def test_a_restart_never_ends_higher_and_one_without_restarts_is_the_first(record):
    once, twice = (
        replace(GRID[PAPER], restarts=n, protocol=replace(GRID[PAPER].protocol, population=40)) for n in (0, 2)
    )
    for seed in (1, 2, 3):
        assert pools.one_run(twice, record, 5, seed)[2] <= pools.one_run(once, record, 5, seed)[2]


def test_a_positive_box_gives_a_positive_amplitude(record):
    candidate = replace(GRID[AUTHORS], positive=True)
    assert min(pools.one_run(candidate, record, 5, seed)[0] for seed in range(1, 6)) > 0


def test_free_timing_starts_from_the_datas_and_finds_a_misfit_of_its_own(record):
    small = replace(GRID[AUTHORS], free_timing=True, protocol=replace(Protocol(), population=20, iterations=5))
    A, _, rmse = pools.one_run(small, record, 5, 1)
    assert 0 < rmse < population_rmse(record.t, record.v, np.array([[0, 0, 5, 6, 99, 0.1, 0]]), Protocol().timing)[0]
    assert abs(A) < 1.5


def test_a_start_drawn_once_for_a_record_is_shared_by_a_block_of_runs():
    per_record, per_run = (replace(Protocol(), start=start) for start in ("per record", "per run"))
    drawn = [pools._start(per_record, 3, seed) for seed in range(1, 2 * pools.BLOCK + 1)]
    assert len(set(drawn[: pools.BLOCK])) == len(set(drawn[pools.BLOCK :])) == 1
    assert len({pools._start(per_run, 3, seed) for seed in range(1, 21)}) > 10
    assert pools._start(Protocol(), 3, 1) == 0


def test_a_pool_keeps_what_it_has_and_computes_what_it_lacks(record, tmp_path, monkeypatch):
    monkeypatch.setattr(pools, "records", lambda label: {5: record})
    quick = replace(GRID[AUTHORS], protocol=replace(Protocol(), population=10, iterations=5))
    first = pools.extend_pool(quick, ["R1"], 2, tmp_path, jobs=1)
    again = pools.extend_pool(quick, ["R1"], 3, tmp_path, jobs=1)
    assert again["seed"].tolist() == [1, 2, 3]
    pd.testing.assert_frame_equal(again.head(2), first)


def test_the_predicted_sd_of_a_pool_with_strays_is_that_of_thirty_runs_with_some():
    runs = made_pool(stray=0.1)["A_rps"].abs().to_numpy()
    drawn = predictive.predicted([runs], np.random.default_rng(1))
    assert drawn[:, 0].mean() == pytest.approx(runs.mean(), rel=0.005)
    assert drawn[:, 1].mean() == pytest.approx(0.14 * math.sqrt(0.09), rel=0.1)
    none = (drawn[:, 1] < 0.005).mean()
    assert none == pytest.approx(0.9**30, abs=0.04)


def test_the_widths_are_how_far_two_realisations_are_apart():
    runs = pd.concat([made_pool(0.7, records=["R1"]), made_pool(0.7 * math.exp(0.02), records=["R2"], seed=1)])
    mean, sd = predictive.widths(runs)
    assert mean == pytest.approx(0.02, abs=0.001)
    assert sd == predictive.LEAST_SD_WIDTH


def test_the_likelihood_of_a_row_is_a_density():
    drawn = np.array([[0.7, 0.01], [0.71, 0.02]])
    mean, sd = np.linspace(math.log(0.6), math.log(0.8), 300), np.linspace(math.log(1e-4), math.log(1.0), 400)
    points = np.exp(np.stack(np.meshgrid(mean, sd, indexing="ij"), axis=-1).reshape(-1, 2))
    density = np.exp(predictive.log_likelihood(points, drawn, WIDTH, 0.72))
    assert density.sum() * (mean[1] - mean[0]) * (sd[1] - sd[0]) == pytest.approx(1, abs=0.005)


def test_a_row_that_no_draw_comes_near_costs_what_a_row_from_elsewhere_costs():
    far = predictive.log_likelihood(np.array([[0.7, 0.2]]), np.array([[0.7, 0.001]]), WIDTH, 0.7)[0]
    near = predictive.log_likelihood(np.array([[0.7, 0.001]]), np.array([[0.7, 0.001]]), WIDTH, 0.7)[0]
    assert far == pytest.approx(math.log(0.01 / (math.log(1.1 / 0.9) * math.log(1000))), abs=1e-6)
    assert near > far + 8


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """Pools of a quiet and of a straying candidate, and a table that the straying one printed."""
    quiet, straying = AUTHORS, PAPER
    for name, stray in ((quiet, 0.0), (straying, 0.15)):
        pools.file_of(name, tmp_path).parent.mkdir(exist_ok=True)
        made_pool(stray=stray, seed=3).to_csv(pools.file_of(name, tmp_path), index=False)
    monkeypatch.setattr(protocols, "GRID", {name: GRID[name] for name in (quiet, straying)})
    table = protocols.predicted_tables(straying, pools.pool(straying, tmp_path), WIDTH, draws=1)[0]
    monkeypatch.setattr(protocols, "printed_rows", lambda: np.column_stack([table, np.full(10, 0.7)]))
    return tmp_path


def test_the_candidate_that_printed_a_table_gets_the_share(kept):
    table = protocols.ranking(protocols.likelihood_table(WIDTH, kept), WIDTH, kept)
    assert table["protocol"].tolist() == [PAPER, AUTHORS]
    assert table["share"].iloc[0] > 0.99
    assert table["best_basin_share"].tolist() == pytest.approx([0.85, 1.0], abs=0.03)


def test_five_rows_choose_it_and_the_other_five_accept_it(kept):
    likelihoods = protocols.likelihood_table(WIDTH, kept)
    simulated = {
        name: protocols.simulated_likelihoods(name, pools.pool(name, kept), WIDTH, 200) for name in likelihoods.T
    }
    splits = protocols.choices(likelihoods, simulated)
    assert len(splits) == 252
    assert (splits["protocol"] == PAPER).all()
    assert splits["p"].median() > 0.05
    assert set(protocols.chosen_by_other_half(likelihoods).values()) == {PAPER}
    assert protocols.joint_p(dict.fromkeys(ROWS, AUTHORS), likelihoods, simulated) < 0.01


def test_a_region_holds_95_percent_of_other_tables_of_its_candidate(kept):
    runs = pools.pool(PAPER, kept)
    table = protocols.table2_regions(dict.fromkeys(ROWS, PAPER), folder=kept)
    width = predictive.widths(pools.pool(AUTHORS, kept))
    rng = np.random.default_rng(8)
    inside = []
    for row in table.to_dict("records"):
        drawn = predictive.predicted(pools.realisations(runs, row["row"], GRID[PAPER]), rng, 500)
        moved = drawn * np.exp(np.array(width) * rng.standard_normal(drawn.shape))
        value = moved[:, 0 if row["column"] == "mean" else 1]
        inside.append(((row["low"] <= value) & (value <= row["high"])).mean())
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)


def test_regions_are_given_by_cell(kept):
    found = protocols.regions(PAPER, folder=kept)
    assert len(found) == 20
    assert set(found) <= set(published.cells("Table 2").index)
    assert all(low < high for low, high in found.values())


def test_the_cells_of_the_chosen_are_those_of_thirty_runs(kept):
    cells = protocols.chosen_cells(dict.fromkeys(ROWS, AUTHORS), folder=kept)
    assert cells["table2.row01.mean"] == pytest.approx(0.7, rel=0.002)
    assert cells["table2.row10.sd"] == pytest.approx(0.0014, rel=0.4)


# ------------------------------------------------------------------------------------------------ the committed pools


def test_every_candidate_has_its_runs_and_the_pools_are_small():
    for name in GRID:
        runs = pools.pool(name)
        least = protocols.first_runs(name) // 2
        counts = runs[runs["record"].isin(protocols.OF_AUTHORS)].groupby(["record", "row"]).size()
        assert len(counts) == 20
        assert counts.min() >= least
    assert sum(path.stat().st_size for path in pools.FOLDER.iterdir()) < 2e6


def test_no_candidate_close_to_the_best_was_dropped():
    table = pd.read_csv(pools.FOLDER.parent / "protocols.csv")
    best = table["log_likelihood"].max()
    dropped = table[table["dropped"]]
    assert (dropped["log_likelihood"] < best - protocols.DROPPED_BELOW / 2).all()
    assert table.loc[~table["dropped"], "runs_a_row"].min() >= protocols.CONTENDER
