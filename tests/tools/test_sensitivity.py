import subprocess
import sys
from dataclasses import fields

import pandas as pd
import pytest

import workbook
from replication.simulator.parameters import JointParameters, identified_joint, with_ratios
from tests.tools import sensitivity

MATRIX = workbook.ROOT / "results" / "sensitivity.csv"
COMMITTED = pd.read_csv(MATRIX, keep_default_na=False) if MATRIX.exists() else None
needs_matrix = pytest.mark.skipif(
    COMMITTED is None, reason="not made yet: make studies NAME=sensitivity"
)

# Off in the identified joint, so that there is nothing to be wrong; options of the simulator, tested by themselves.
OFF = {
    *("clamped", "motor_viscous_nms_per_rad", "load_viscous_nms_per_rad", "motor_coulomb_nm"),
    *("torque_limit_nm", "encoder_bits", "speed_by_differencing", "disturbances"),
}


def test_every_constant_of_the_joint_is_changed():
    joint = identified_joint()
    other = with_ratios(joint, {name: 1.05 * value for name, value in joint.ratios.items()})
    names = {field.name for field in fields(JointParameters)} - set(sensitivity.JOINT)
    assert {name for name in names if getattr(other, name) == getattr(joint, name)} == OFF
    changed = {change.constant for change in sensitivity.changes()}
    assert {f"joint, {name}" for name in joint.ratios} <= changed


def test_the_code_of_every_change_runs():
    code = "\n".join(change.code for change in sensitivity.changes())
    subprocess.run([sys.executable, "-c", code], cwd=workbook.ROOT, check=True)


@needs_matrix
def test_every_constant_is_noticed_and_is_in_the_committed_table():
    assert COMMITTED["constant"].unique().tolist() == [
        change.constant for change in sensitivity.changes()
    ]
    assert (COMMITTED["group"] != "").all(), "a constant that nothing notices is a missing test"


@needs_matrix
def test_every_test_in_the_matrix_exists():
    tests = "\n".join(
        path.read_text("utf-8") for path in (workbook.ROOT / "tests").rglob("test_*.py")
    )
    named = set(COMMITTED.loc[COMMITTED["kind"] == "test", "id"])
    assert len(named) > 5
    for name in named:
        assert f"def {name}(" in tests, name


@pytest.mark.slow
@needs_matrix
def test_wrong_constants_are_noticed_by_a_notebook_and_the_tests_as_the_committed_matrix_says(
    authors_data,
):
    wrong = ["text.encoder_bits", "equation10.A3"]
    chosen = [change for change in sensitivity.changes() if change.constant in wrong]
    table = sensitivity.sensitivity(chosen, sensitivity.EQUATION_10)
    assert set(wrong) <= set(table["constant"])
    assert table["id"].tolist() == COMMITTED.loc[COMMITTED["constant"].isin(wrong), "id"].tolist()


def test_only_what_agreed_can_notice_and_only_more_than_its_tolerance_counts():
    cells = {"reproduced": 0.2618, "differs": 0.2618, "consistent": 0.2618}
    before = {("cell", "table2.row01.mean", word): (value, word) for word, value in cells.items()}
    near = {key: (value + 1e-6, word) for key, (value, word) in before.items()}
    far = {key: (2 * value, word) for key, (value, word) in before.items()}
    assert sensitivity.noticing(before, near) == []
    assert [key[2] for key, *_ in sensitivity.noticing(before, far)] == ["reproduced", "consistent"]
    assert [key[2] for key, *_ in sensitivity.noticing(before, {})] == ["reproduced", "consistent"]
    assert sensitivity.noticing({("test", "x", ""): (1.0, "")}, {("test", "x", ""): (0.0, "")})


def test_what_is_missing_is_counted_apart_from_what_moves():
    hits = pd.DataFrame({"id": ["moved", "missing"], "after": [0.5, None]})
    about = {"constant": "x", "value": 1, "changed": 2, "group": "Table 2, theoretical A"}
    (row,) = sensitivity.matrix(hits.assign(**about))["rows"]
    assert (row["counts"], row["missing"]) == ({about["group"]: 1}, 1)
