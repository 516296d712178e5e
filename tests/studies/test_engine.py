"""The engine gives the paper's joint, its logs are answered, and the kept table is what the study makes."""

import re

import numpy as np
import pandas as pd
import pytest

from backlash.cli.options import _WRONG
from replication.files import ROOT
from replication.joint import identified_joint
from studies import datasheet, engine
from workbook.judging import decide

JOINT = identified_joint()


@pytest.fixture
def mujoco():
    """The physics engine, which `make .venv/.studies` installs."""
    return pytest.importorskip("mujoco", reason="needs the package mujoco-core")


def build(mujoco, machine):
    model = engine.build_model(machine, 1e-4)
    return model, mujoco.MjData(model)


KEPT = pd.read_csv(ROOT / "results" / "engine.csv")


def test_the_engine_gives_the_paper_s_joint_as_it_was_kept(mujoco):
    twin = KEPT.set_index("step_s").loc[engine.TWIN_STEPS_S[0]]
    assert engine.measure_twin(twin.name) == pytest.approx(twin["nrmse"], rel=1e-3)


def test_an_arm_s_first_swing_is_as_fast_as_the_help_says(mujoco):
    low, high = map(float, re.search(r"own resonance, (\d+) to (\d+) Hz", _WRONG).groups())
    for number in range(0, engine.LOGS[engine.ARM], len(engine.ARM_PLAYS_RAD)):
        arm = engine.draw_machine(engine.ARM, number)
        model, data = build(mujoco, arm)
        data.qpos[6:] = arm.each.start_angle
        mujoco.mj_forward(model, data)
        inertia = np.empty((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        # Rotors and wrist 3 held, the other gears yield.
        squares = np.linalg.eigvals(np.linalg.solve(inertia[6:11, 6:11], np.diag(arm.each.K_s[:5])))
        assert low < np.sqrt(squares.real.min()) / (2 * np.pi) < high


def test_the_load_that_hangs_from_a_joint_has_its_inertia_and_gravity(mujoco):
    model, data = build(mujoco, engine.mount_joint(JOINT, 1e-3))
    data.qacc[:] = 1
    mujoco.mj_inverse(model, data)
    assert data.qfrc_inverse == pytest.approx([JOINT.J_m, JOINT.J_l])
    data.qpos[:] = 0, np.pi / 2
    mujoco.mj_forward(model, data)
    assert data.qfrc_bias == pytest.approx([0, JOINT.G])


def test_teeth_push_outside_the_gap_and_only_drag_inside_it():
    x, rate = np.array([[2e-3, 5e-4, 2e-3, -2e-3], [0.1, 0.1, -10.0, 10.0]])
    gears = np.tile([[10.0], [500.0], [2.0], [1e-3], [0.25]], 4)  # N, K_s, D_s, delta, drag
    applied = np.empty(8)
    engine.damp_gears(np.append(10 * x, 0 * x), np.append(10 * rate, 0 * x), gears, applied)
    on_rotor, on_load = np.split(applied, 2)
    assert on_rotor == pytest.approx(-on_load / 10)
    # In contact the spring pushes by 0.5 N m; when the teeth part fast, no more is left of it than the drag.
    assert on_load == pytest.approx([0.2, 0.05, -5.0 - 0.5, 5.0 + 0.5])


def test_the_last_joint_of_an_arm_turns_about_a_horizontal_axis_and_carries_the_payload(mujoco):
    machine = engine.draw_arm(np.random.default_rng(1), 1e-3, 0.0)
    model, data = build(mujoco, machine)
    data.qpos[6:] = machine.each.start_angle
    squares = 0.0
    for quarter in (0.0, np.pi / 2):
        data.qpos[11] = quarter
        mujoco.mj_forward(model, data)
        squares += data.qfrc_bias[11] ** 2
    assert data.xaxis[-1][2] == pytest.approx(0, abs=1e-12)
    assert squares == pytest.approx(machine.joints[-1].G ** 2, rel=1e-9)


def test_the_table_has_a_row_for_each_log_that_the_study_makes():
    logs = KEPT[KEPT["population"] != engine.TWIN]
    assert logs["population"].value_counts().to_dict() == engine.LOGS


def test_the_sensor_is_right_on_the_engine_s_joints_and_silent_on_its_arm():
    sheet = datasheet.summarise_engine(KEPT).set_index("population")
    turns, strokes = sheet.loc["MuJoCo, turns"], sheet.loc["MuJoCo, strokes"]
    assert turns["answered"] >= 0.9 * turns["joints"]
    assert turns["covered"] >= 0.95 * turns["answered"]
    assert strokes["covered"] >= 0.8 * strokes["joints"]
    assert sheet[["false_all_clears", "healthy_called"]].to_numpy().sum() == 0
    assert sheet["wrong"].drop(turns.name).sum() == 0


def test_the_kept_errors_fall_with_the_step_to_the_first_order():
    twins = KEPT[KEPT["population"] == engine.TWIN]
    assert tuple(twins["step_s"]) == engine.TWIN_STEPS_S
    slope = np.polyfit(np.log(twins["step_s"]), np.log(twins["nrmse"]), 1)[0]
    assert slope == pytest.approx(1, abs=0.1)
    assert twins["nrmse"].min() < 6e-4


def test_what_is_said_of_the_simulated_arm_follows_from_its_rows_and_decides_nothing():
    numbers, words = engine.measure_arms(KEPT)
    assert decide("full_robot", numbers) is None
    claims = pd.read_csv(ROOT / "results" / "claims.csv").set_index("id")
    assert claims.loc["full_robot", "measured"] == words
    moved = KEPT[KEPT["population"] == engine.ARM].reset_index()
    moved["amplitude_rps"] = moved["delta_rad"] * 1e3 + 1
    moved.loc[1, ["verdict", "low_rad", "high_rad"]] = "backlash", 0, 1
    _, words = engine.measure_arms(moved)
    assert "on 5 of 5 arms, by 1.20 to 1.20 rps" in words
    assert "shoulder and elbow moves it by 0 rps" in words
    assert "the largest above that of 0 arms" in words
    assert "By torque 1 of 10 logs with play are answered, 0 of 20 wrong" in words
