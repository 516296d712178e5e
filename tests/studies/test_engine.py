"""The engine gives the paper's joint, its logs are answered, and the kept table is what the study makes."""

import re

import numpy as np
import pandas as pd
import pytest

from backlash.cli.options import _WRONG
from backlash.estimates import NONE
from replication.files import ROOT
from replication.joint import identified_joint
from studies import datasheet, engine
from workbook.judging import decide

JOINT = identified_joint()


@pytest.fixture
def mujoco():
    """The physics engine, which `make .venv/.studies` installs."""
    return pytest.importorskip("mujoco", reason="needs the package mujoco-core")


@pytest.fixture(scope="module")
def kept():
    return pd.read_csv(ROOT / "results" / "engine.csv")


def test_the_engine_gives_the_paper_s_joint_to_the_first_order_in_its_step(kept, mujoco):
    coarse, fine = (engine.measure_twin(step_s) for step_s in (1e-4, 2.5e-5))
    assert coarse / fine == pytest.approx(4, rel=0.15)
    twins = kept[kept["population"] == engine.TWIN].set_index("step_s")
    assert fine == pytest.approx(twins.loc[2.5e-5, "nrmse"], rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("population", [engine.TURNS, engine.HEALTHY])
def test_the_sensor_is_right_on_a_log_of_the_engine_and_the_kept_row_is_made_again(
    population, kept, mujoco
):
    made = engine.measure_log(population, 0)
    if population == engine.HEALTHY:
        assert made["verdict"] == NONE
    else:
        assert made["low_rad"] < made["delta_rad"] < made["high_rad"]
    row = kept.set_index(["population", "number"]).loc[(population, 0)]
    assert made["verdict"] == row["verdict"]
    assert made["delta_rad"] == pytest.approx(row["delta_rad"], rel=1e-5)  # six digits are kept
    for name in ("backlash_rad", "low_rad", "high_rad"):
        assert made[name] == pytest.approx(row[name], rel=1e-2)


@pytest.mark.slow
def test_the_log_of_a_swinging_arm_is_refused_the_refusal_asks_for_the_arm_and_the_index_is_kept(
    kept, mujoco
):
    log = engine.log_of(engine.ARM, 1)
    index = engine.ask_sensor(log, **engine.BY_POSITION, **engine.BY_SPEED_ALONE).amplitude_rps
    row = kept.set_index(["population", "number"]).loc[(engine.ARM, 1)]
    assert index == pytest.approx(row["amplitude_rps"], rel=1e-4)
    answer = engine.ask_sensor(log, **engine.BY_POSITION)
    assert answer.reason == "no joint fits"
    assert "other axes held still" in answer.explanation
    assert "is the arm stiff beside the payload" in answer.explanation


def test_an_arm_s_first_swing_is_as_fast_as_the_help_says(mujoco):
    low, high = map(float, re.search(r"own resonance, (\d+) to (\d+) Hz", _WRONG).groups())
    for arm in range(0, engine.LOGS[engine.ARM], len(engine.ARM_PLAYS_RAD)):
        machine = engine.draw_machine(engine.ARM, arm)
        model = engine.build_model(machine, 1e-4)
        data = mujoco.MjData(model)
        data.qpos[6:] = machine.of_joints("start_angle")
        mujoco.mj_forward(model, data)
        inertia = np.empty((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        # Rotors and wrist 3 held, the other gears yield.
        squares = np.linalg.eigvals(
            np.linalg.solve(inertia[6:11, 6:11], np.diag(machine.of_joints("K_s")[:5]))
        )
        assert low < np.sqrt(squares.real.min()) / (2 * np.pi) < high


def test_the_load_that_hangs_from_a_joint_has_its_inertia_and_gravity(mujoco):
    model = engine.build_model(engine.mount_joint(JOINT, 1e-3), 1e-4)
    data = mujoco.MjData(model)
    data.qacc[:] = 1
    mujoco.mj_inverse(model, data)
    assert data.qfrc_inverse == pytest.approx([JOINT.J_m, JOINT.J_l])
    data.qpos[:] = 0, np.pi / 2
    mujoco.mj_forward(model, data)
    assert data.qfrc_bias == pytest.approx([0, JOINT.G])


def test_teeth_push_outside_the_gap_and_only_drag_inside_it():
    gear = np.array([[10.0], [500.0], [2.0], [1e-3], [0.25]])  # N, K_s, D_s, delta, drag
    applied = np.empty(2)
    on_load = []
    for x, rate in ((2e-3, 0.1), (5e-4, 0.1), (2e-3, -10.0), (-2e-3, 10.0)):
        position, speed = np.array([10 * x, 0.0]), np.array([10 * rate, 0.0])
        engine.damp_gears(position, speed, gear, applied)
        assert applied[0] == pytest.approx(-applied[1] / 10)
        on_load.append(applied[1])
    # In contact the spring pushes by 0.5 N m; when the teeth part fast, no more is left of it than the drag.
    assert on_load == pytest.approx([0.2, 0.05, -5.0 - 0.5, 5.0 + 0.5])


def test_the_last_joint_of_an_arm_turns_about_a_horizontal_axis_and_carries_the_payload(mujoco):
    machine = engine.draw_arm(np.random.default_rng(1), 1e-3, 0.0)
    model = engine.build_model(machine, 1e-4)
    data = mujoco.MjData(model)
    data.qpos[6:] = machine.of_joints("start_angle")
    moments = []
    for turned in np.linspace(0, 2 * np.pi, 24, endpoint=False):
        data.qpos[11] = turned
        mujoco.mj_forward(model, data)
        moments.append(data.qfrc_bias[11])
    assert data.xaxis[-1][2] == pytest.approx(0, abs=1e-12)
    assert max(moments) == pytest.approx(machine.joints[-1].G, rel=0.02)


def test_the_table_has_a_row_for_each_log_that_the_study_makes(kept):
    logs = kept[kept["population"] != engine.TWIN]
    assert logs["population"].value_counts().to_dict() == engine.LOGS
    assert logs["verdict"].notna().all()
    assert (logs["reason"].notna() == (logs["verdict"] == "cannot tell")).all()


def test_the_sensor_is_right_on_the_engine_s_joints_and_silent_on_its_arm(kept):
    sheet = datasheet.summarise_engine(kept).set_index("population")
    turns = sheet.loc["MuJoCo, turns"]
    assert turns["answered"] >= 0.9 * turns["joints"]
    assert turns["covered"] >= 0.95 * turns["answered"]
    assert turns["false_all_clears"] == turns["healthy_called"] == 0
    assert sheet.loc["MuJoCo, drag in the gap", "wrong"] == sheet.loc["MuJoCo, arm", "wrong"] == 0


def test_the_sensor_is_right_on_the_engine_s_strokes_within_the_limits_that_were_fixed_before(kept):
    sheet = datasheet.summarise_engine(kept).set_index("population")
    strokes = sheet.loc["MuJoCo, strokes"]
    assert strokes["covered"] >= 0.8 * strokes["joints"]
    assert strokes["wrong"] == strokes["healthy_called"] == 0


def test_the_kept_errors_fall_with_the_step_to_the_first_order(kept):
    twins = kept[kept["population"] == engine.TWIN]
    assert tuple(twins["step_s"]) == engine.TWIN_STEPS_S
    slope = np.polyfit(np.log(twins["step_s"]), np.log(twins["nrmse"]), 1)[0]
    assert slope == pytest.approx(1, abs=0.1)
    assert twins["nrmse"].min() < 6e-4


def test_what_is_said_of_the_simulated_arm_follows_from_its_rows_and_decides_nothing(kept):
    numbers, words = engine.measure_arms(kept)
    assert decide("full_robot", numbers) is None
    claims = pd.read_csv(ROOT / "results" / "claims.csv").set_index("id")
    assert claims.loc["full_robot", "measured"] == words
    A = kept[kept["population"] == engine.ARM].pivot(
        index="number", columns="population", values="amplitude_rps"
    )
    gains = (A.loc[2::4].to_numpy() - A.loc[0::4].to_numpy()).ravel()
    assert f"by {gains.min():.2f} to {gains.max():.2f} rps at 1.2 mrad" in words
    moved = kept.copy()
    is_arm = moved["population"] == engine.ARM
    moved.loc[is_arm, "amplitude_rps"] = moved.loc[is_arm, "delta_rad"] * 1e3 + 1
    moved.loc[is_arm & (moved["number"] == 1), ["verdict", "low_rad", "high_rad"]] = (
        "backlash",
        0,
        1,
    )
    _, words = engine.measure_arms(moved)
    assert "on 5 of 5 arms, by 1.20 to 1.20 rps" in words
    assert "shoulder and elbow moves it by 0 rps" in words
    assert "the largest above that of 0 arms" in words
    assert "By torque 1 of 10 logs with play are answered, 0 of 20 wrong" in words
