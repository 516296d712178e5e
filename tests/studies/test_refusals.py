"""The study of refusals: sound logs of every logger are not refused, and each fault is named by its rule."""

import numpy as np
import pytest

from studies import refusals


@pytest.fixture(scope="module")
def table():
    return refusals.measure_all(joints=3).set_index("rule")


def test_no_sound_log_is_refused_and_faulty_ones_are_for_their_fault(table):
    assert table.loc[refusals.OTHER, "false_refusals"] == table["false_refusals"].sum() == 0
    assert (table["sound"] == 3 * refusals.WRITINGS).all()
    rules = table.drop(index=refusals.OTHER)
    assert (rules["caught"] + rules["refused_otherwise"] <= rules["faulty"]).all()
    assert rules["caught"].sum() >= 0.9 * rules["faulty"].sum()


def test_a_run_begins_at_rest_and_its_logs_differ_in_rate_and_column():
    run, options, settled = refusals.run_from_rest(np.random.default_rng(1))
    assert run["speed"].iloc[0] == 0.0
    assert run["speed"].iloc[settled:].std() < 0.05 * run["speed"].iloc[-1]
    logs = [refusals.write_log(run, options, settled, np.random.default_rng(k)) for k in range(20)]
    assert {log.columns[1] for log, _ in logs} == {
        *("speed [rps]", "speed [rpm]", "position [counts]")
    }
    assert len({len(log) for log, _ in logs}) > 5
