from dataclasses import replace

import numpy as np
import pytest

from replication import published
from replication.signature import Timing, rmse
from replication.table2 import AUTHORS_SETTINGS, search_box
from studies.replay import table1
from studies.replay.inspection import STORED_NAMES


@pytest.fixture(scope="module")
def stored_box(record_12):
    return search_box(record_12, AUTHORS_SETTINGS)


def test_in_the_stored_runs_box_all_thirty_first_generations_replay(record_12, stored_box):
    assert table1.count_replayed(record_12, stored_box) == 30


def test_in_table_1s_box_of_A_hardly_one_replays(record_12):
    box = search_box(record_12, replace(AUTHORS_SETTINGS, amplitude_factor=1.0))
    assert table1.count_replayed(record_12, box) <= 1


@pytest.mark.parametrize("i", range(1, 7))
@pytest.mark.parametrize("end", ["lower", "upper"])
def test_a_bound_that_is_a_hundredth_of_its_range_off_loses_first_generations(
    record_12, stored_box, i, end
):
    moved = getattr(stored_box, end).copy()
    moved[i] += 0.01 * (stored_box.upper - stored_box.lower)[i]
    assert table1.count_replayed(record_12, replace(stored_box, **{end: moved})) < 25


def test_twelve_turns_or_more_give_the_stored_misfits_and_fewer_do_not(record_12):
    printed = int(published.value("text.turns"))
    for _, run in published.table("authors_notebook_runs").iterrows():
        X, stored = run[list(STORED_NAMES)].to_numpy(float), run["final_rmse_rps"]
        fewer, printed_turns, more = (
            rmse(record_12.t, record_12.v, X, Timing(run["T_d_s"], run["T_f_s"], n))
            for n in (printed - 1, printed, printed + 7)
        )
        assert abs(fewer - stored) > 1e-6
        assert abs(printed_turns - stored) < 1e-6  # the stored parameters have nine digits
        assert (
            more == printed_turns
        )  # so the number of turns is undecided: a later turn changes nothing


def test_where_two_places_replay_equally_many_the_bound_is_not_told(record_12):
    tried = table1.pd.DataFrame(
        {"cell": "table1.tau.max", "shift": [0.0, 0.1], "bound": [30.0, 32.5], "replayed": [30, 30]}
    )
    assert np.isnan(table1.table1_cells(record_12, tried)["table1.tau.max"])
