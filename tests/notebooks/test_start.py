"""Notebook 0: the equations as it writes them are the simulator's, and its animation needs no network."""

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image
from test_try_changing import run as run_notebook

from replication.figures import teeth
from replication.simulator.parameters import identified_joint
from replication.simulator.simulate import simulate
from workbook import plain_animation


@pytest.fixture(scope="module")
def after(tmp_path_factory):
    """Variables of the notebook after a run."""
    return run_notebook("00_start_here", {}, tmp_path_factory.mktemp("start"))


def test_the_written_out_equations_give_the_simulated_speed(after):
    assert after["difference"].size > 1600
    assert after["difference"].max() < 1e-4


def test_the_joint_rings_where_its_linear_model_says(after):
    decay, omega = after["fitted"][:2]
    assert omega / (2 * np.pi) == pytest.approx(after["ring_hz"], rel=2e-3)
    assert decay == pytest.approx(-after["mode"].real, rel=0.03)
    assert after["two_springs_hz"](after["joint"]) == pytest.approx(after["ring_hz"], rel=0.08)


def test_both_ways_of_the_sensor_come_near_the_true_backlash(after):
    assert -12 < after["error_percent"] < -6
    assert after["answer"].verdict == "backlash"
    low, high = after["answer"].backlash_interval_rad
    assert low < after["delta_rad"] < high


def test_the_animation_is_the_same_every_time_and_asks_nothing_of_a_server(after):
    again = teeth.animate_teeth(after["run"], after["joint"])
    assert plain_animation(again, "arm, teeth and motor speed") == after["animation"]
    assert len(after["animation"].encode()) <= 400_000
    assert not re.search(r"https?:|<link|@import|src=\"(?!data:)", after["animation"])
    assert 'id="_anim_img_teeth"' in after["animation"]


def test_every_button_of_the_animation_says_what_it_does(after):
    buttons = re.findall(r"<button[^>]*>([^<]*)</button>", after["animation"])
    assert buttons == [
        *("Decrease speed", "First frame", "Previous frame", "Play backwards", "Pause", "Play"),
        *("Next frame", "Last frame", "Increase speed"),
    ]
    assert 'aria-label="frame"' in after["animation"]


def test_frames_follow_one_another_faster_while_the_gap_is_open():
    joint = identified_joint()
    run = simulate(joint, 21e-4, duration_s=1.6, sample_s=1e-3)
    html = plain_animation(teeth.animate_teeth(run, joint), "teeth")
    frames = re.findall(r'frames\[\d+\] = "data:image/png;base64,(.*?)"', html)
    open_s = 1e-3 * (run.gap_state[(run.time_s >= 0.4) & (run.time_s < 0.8)] == 0).sum()
    assert len(frames) == pytest.approx(open_s / 0.003 + (0.4 - open_s) / 0.015, abs=4)
    assert Image.open(io.BytesIO(base64.b64decode(frames[0]))).size == (408, 294)
