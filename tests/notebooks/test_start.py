"""Notebooks 0 and 1: the sensor and the joint, which need no network; the equations are the simulator's."""

import re

import numpy as np
import pytest

from replication.signature import Timing, signature
from studies import teeth
from tests.changes import run as run_notebook
from workbook import plain_animation


@pytest.fixture(scope="module")
def after(tmp_path_factory):
    """Variables of notebook 0 after a run."""
    return run_notebook("00_the_sensor", {}, tmp_path_factory.mktemp("start"))


@pytest.fixture(scope="module")
def joint_after(tmp_path_factory):
    """Variables of notebook 1 after a run."""
    return run_notebook("01_the_joint", {}, tmp_path_factory.mktemp("joint"))


def test_the_written_out_equations_give_the_simulated_speed(joint_after):
    assert joint_after["difference"].size > 800
    assert joint_after["difference"].max() < 1e-4


def test_the_joint_rings_where_its_linear_model_says(joint_after):
    decay, omega = joint_after["fitted"][:2]
    mode = joint_after["mode"]
    assert omega == pytest.approx(mode.imag, rel=2e-3)
    assert decay == pytest.approx(-mode.real, rel=0.03)
    assert joint_after["s"][[0, -1]].imag == pytest.approx(mode.imag, rel=0.08)


def test_the_best_run_and_equation_10_come_near_the_true_backlash(after):
    assert 0.88 < after["found_rad"] / after["delta_rad"] < 0.94


def test_the_fitted_signature_is_that_of_equation_7(after):
    X = [*after["explorer"]["fitted"].values()][:7]
    h = signature(after["t"], X, Timing(0.2, 0.4, 12))
    assert np.abs(h - after["fit"])[after["t"] > 0.2].max() < 1e-3


def test_the_animation_is_the_same_every_time_and_asks_nothing_of_a_server(after):
    again = teeth.animate_teeth(after["run"], after["joint"])
    assert plain_animation(again, "arm, teeth and motor speed") == after["animation"]
    assert not re.search(r"\bid=|https?:|<link|@import|src=\"(?!data:)", after["animation"])
