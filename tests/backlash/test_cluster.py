"""The guide's lines for a cluster give the rows that one machine gives, also where a worker dies."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import pytest

from backlash import batch
from backlash.example import LOG
from replication.files import ROOT
from tests.logs import file

GUIDE = (ROOT / "notebooks" / "guide.md").read_text("utf-8")
SENSOR = f'exec "{sys.executable}" -m backlash "$@"\n'
SPEED = "speed [rpm]"
LOGS = 9  # enough for more than one process

pytestmark = pytest.mark.slow


def lines_of(name: str) -> str:
    """The guide's block of code that begins with a comment, its name."""
    return re.search(rf"```\w+\n# {re.escape(name)}\n(.*?)```", GUIDE, re.DOTALL)[1]


@pytest.fixture
def plant(tmp_path, monkeypatch) -> Path:
    """The folder to work in: a table of logs, the sensor's command, and what it answers in one process."""
    rows = [f"{number}.csv,J{number},torque,100,2,30\n" for number in range(LOGS)]
    header = "file,joint,torque,gear_ratio,inertia_ratio,gravity_per_s2\n"
    file(tmp_path, header + "".join(rows), "plant.csv")
    log = pd.read_csv(LOG)
    for number in range(1, LOGS):  # the first one is missing
        noise = np.random.default_rng(number).normal(0, 1, len(log))
        log.assign(**{SPEED: log[SPEED] + noise}).to_csv(tmp_path / f"{number}.csv", index=False)
    file(tmp_path, f"#!/bin/sh\n{SENSOR}", "backlash").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.chdir(tmp_path)
    alone = "backlash estimate --batch plant.csv --jobs 1 --out alone.parquet"
    subprocess.run(alone, check=True, capture_output=True, shell=True)
    return tmp_path


def assert_same_rows(table: pd.DataFrame) -> None:
    alone = pd.read_parquet("alone.parquet")
    assert len(alone) == LOGS
    assert (alone["verdict"] == "backlash").sum() >= LOGS / 2
    table = table.reset_index().sort_values("joint_name" if "joint_name" in table else "joint")
    pd.testing.assert_frame_equal(
        table[[*alone]].reset_index(drop=True), alone, check_exact=True, check_dtype=False
    )


@pytest.fixture
def two_workers():
    """What makes a cluster of two processes on this machine."""
    distributed = pytest.importorskip("distributed")
    here = {"host": "127.0.0.1", "dashboard_address": None}
    return lambda: distributed.LocalCluster(n_workers=2, threads_per_worker=1, **here)


def test_on_two_workers_of_which_one_dies_the_rows_are_those_made_alone(
    plant, two_workers, monkeypatch
):
    def kill_a_worker(answers, **_):
        for count, each in enumerate(answers):
            if count == 2:
                workers = psutil.Process().children()
                next(each for each in workers if "spawn_main" in "".join(each.cmdline())).kill()
            yield each

    monkeypatch.setattr(batch, "tqdm", kill_a_worker)
    lines = lines_of("cluster.py").replace("LocalCluster()", "two_workers()")
    exec(lines, {"__name__": "__main__", "two_workers": two_workers})
    assert_same_rows(pd.read_parquet("answers.parquet"))


def test_the_parts_of_a_job_array_have_together_the_rows_made_alone(plant):
    job = ["sh", "-c", lines_of("part.sh"), "part.sh"]
    for part in ("1", "2"):
        subprocess.run([*job, part, "2"], check=True, capture_output=True)
    parts = [pd.read_parquet(f"part-{part}.parquet") for part in (1, 2)]
    assert_same_rows(pd.concat(parts))
