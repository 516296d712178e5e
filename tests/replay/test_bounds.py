from dataclasses import replace

import numpy as np
import pytest

from replication import published
from replication.identify import protocol_box
from replication.replay import bounds
from replication.table2 import AUTHORS


@pytest.fixture(scope="module")
def stored_box(record_12):
    return protocol_box(record_12, AUTHORS)


def test_in_the_stored_runs_box_all_thirty_first_generations_replay(record_12, stored_box):
    assert bounds.count_replayed(record_12, stored_box) == 30


def test_in_table_1s_box_of_A_hardly_one_replays(record_12):
    box = protocol_box(record_12, replace(AUTHORS, amplitude_factor=1.0))
    assert bounds.count_replayed(record_12, box) <= 1


@pytest.mark.parametrize("i", range(1, 7))
@pytest.mark.parametrize("end", ["lower", "upper"])
def test_a_bound_that_is_a_hundredth_of_its_range_off_loses_first_generations(record_12, stored_box, i, end):
    moved = getattr(stored_box, end).copy()
    moved[i] += 0.01 * (stored_box.upper - stored_box.lower)[i]
    assert bounds.count_replayed(record_12, replace(stored_box, **{end: moved})) < 25


def test_fewer_than_twelve_turns_do_not_give_the_stored_misfits(record_12):
    counts = bounds.turns_by_replay(record_12)
    assert counts[counts == 30].index.min() == published.value("text.turns")
    assert (counts.loc[:11] == 0).all()


def test_where_two_places_replay_equally_many_the_bound_is_not_told(record_12):
    tried = bounds.pd.DataFrame(
        {"cell": "table1.tau.max", "shift": [0.0, 0.1], "bound": [30.0, 32.5], "replayed": [30, 30]}
    )
    assert np.isnan(bounds.table1_cells(record_12, tried)["table1.tau.max"])
