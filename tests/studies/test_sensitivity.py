from dataclasses import fields, replace

import pandas as pd
import pytest

from replication import workbook
from replication.studies import sensitivity

COMMITTED = pd.read_csv(workbook.ROOT / "results" / "sensitivity.csv", keep_default_na=False)

# Off in the identified joint, so that there is nothing to be wrong; options of the simulator, tested by themselves.
OFF = {
    *("clamped", "motor_viscous_nms_per_rad", "load_viscous_nms_per_rad", "motor_coulomb_nm"),
    *("torque_limit_nm", "encoder_bits", "speed_by_differencing", "disturbances"),
}


@pytest.fixture(scope="module")
def base():
    return sensitivity.nominal()


def changed_fields(before, after):
    return {field.name for field in fields(before) if getattr(before, field.name) != getattr(after, field.name)}


def test_every_constant_of_the_joint_the_protocol_and_the_sensor_is_changed(base):
    changes = sensitivity.changes(base)
    for room, idle in (("joint", OFF), ("protocol", {"name", "start"})):
        before = getattr(base, room)
        touched = set().union(*(changed_fields(before, getattr(change.setup, room)) for change in changes))
        assert {field.name for field in fields(before)} - touched == idle
    assert set().union(*(changed_fields(base, change.setup) for change in changes)) == {f.name for f in fields(base)}


def test_no_two_changes_have_one_name_and_each_says_what_it_changes(base):
    changes = sensitivity.changes(base)
    assert len({change.constant for change in changes}) == len(changes)
    assert all(change.value != change.changed and change.setup != base for change in changes)


def test_every_constant_is_noticed_and_is_in_the_committed_table(base):
    assert COMMITTED["constant"].unique().tolist() == [change.constant for change in sensitivity.changes(base)]
    assert (COMMITTED["group"] != "").all(), "a constant that nothing notices is a missing test"


def test_every_test_in_the_matrix_exists():
    tests = "\n".join(path.read_text(encoding="utf-8") for path in (workbook.ROOT / "tests").glob("test_*.py"))
    named = set(COMMITTED.loc[COMMITTED["kind"] == "test", "id"])
    assert len(named) > 5
    for name in named:
        assert f"def {name}(" in tests, name


def test_the_unchanged_setup_gives_the_committed_verdicts(base, authors_data):
    found = sensitivity.found(base)
    committed = pd.read_csv(workbook.ROOT / "results" / "verdicts.csv").set_index(["id", "source"])["reproduced"]
    claims = pd.read_csv(workbook.ROOT / "results" / "claims.csv").set_index("id")["holds"]
    exact = 0
    for (kind, name, source), value in found.items():
        if kind == "test":
            assert value == 1, name
        elif kind == "claim" and name != "error_below_10":  # by the mean of the runs, not by the global fit
            assert value == claims[name], name
        elif (kind == "cell" and not name.startswith("table2.")) or name.endswith("theoretical"):
            assert value == pytest.approx(committed[name, source], rel=1e-4, abs=1e-9), name
            exact += 1
    assert exact > 40


def test_a_wrong_coefficient_of_equation_10_is_noticed_and_an_unchanged_setup_is_not(base, authors_data):
    before = sensitivity.found(base)
    assert sensitivity.noticing(before, sensitivity.found(replace(base))) == []
    wrong = replace(base, equation10=(*base.equation10[:3], 1.05 * base.equation10[3]))
    assert ("cell", "equation10.A3", "authors") in sensitivity.noticing(before, sensitivity.found(wrong))


def test_the_committed_matrix_is_what_the_command_gives_for_a_cheap_constant(base, authors_data):
    before = sensitivity.found(base)
    for change in sensitivity.changes(base):
        if change.constant in ("rpm_per_rps", "turn_period_s", "encoder_bits", "protocol, latest_start"):
            rows = COMMITTED[COMMITTED["constant"] == change.constant]
            hits = sensitivity.noticing(before, sensitivity.found(change.setup))
            assert [name for _, name, _ in hits] == rows["id"].tolist()
