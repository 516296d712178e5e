"""Logs of many joints in one call, on one machine or a cluster."""

import errno
import json
import os
import shutil
import signal

import joblib
import pandas as pd
import pytest

import backlash
from backlash import commands, fleet
from backlash.settings import settings_for
from tests.logs import TURN, command, noisy, table, write
from tests.sensor.test_interface import KNOWN_RAD
from tests.sensor.test_torque_logs import logged

HOW = {"turn_period_s": 0.4, "method": "energy"}


@pytest.fixture
def dated(tmp_path):
    """A table with four dates of two joints; A2 is worn faster."""
    rows = []
    for month in range(1, 5):
        for joint, growth in (("A1", 1e-4), ("A2", 3e-4)):
            log = write(noisy(4e-4 + month * growth, seed=month), tmp_path / f"{joint}{month}.csv")
            rows.append((log.name, joint, f"2024-0{month}-15"))
    path = tmp_path / "plant.csv"
    pd.DataFrame(rows, columns=["file", "joint", "date"]).to_csv(path, index=False)
    return path


def test_each_joint_has_its_calibration_its_torque_and_its_load(tmp_path, capsys):
    frame, known = logged(3)
    frame.to_csv(tmp_path / "torque.csv", index=False)
    write(noisy(), tmp_path / "speed.csv")
    own = backlash.calibrate([table(noisy(delta)) for delta in KNOWN_RAD], KNOWN_RAD, **HOW)
    (tmp_path / "own.json").write_text(own.to_json(), "utf-8")
    rows = pd.DataFrame(
        [
            known | {"file": "torque.csv", "joint": "007", "date": "2024-03-17"},
            {"file": "speed.csv", "joint": "A2", "turn_period_s": 0.4, "calibration": "own.json"},
        ]
    )
    rows.to_csv(tmp_path / "plant.csv", index=False)
    found = backlash.estimate_many(tmp_path / "plant.csv")
    assert found.index.names == ["joint", "date"]
    assert found.loc["007", "method"].tolist() == ["torque"]
    assert found.loc["A2", "calibration"].tolist() == [own.provenance]
    assert (found["verdict"] == "backlash").all()
    out = tmp_path / "answers.parquet"
    assert command("estimate --batch", tmp_path / "plant.csv", "--out", out, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert [(row["joint"], row["date"]) for row in printed] == [("007", "2024-03-17"), ("A2", "")]
    again = pd.read_parquet(out).set_index(["joint", "date"])
    pd.testing.assert_frame_equal(again, found, check_dtype=False)
    rows["gravity_per_s2"] = "much"
    rows.to_csv(tmp_path / "plant.csv", index=False)
    found = backlash.estimate_many(tmp_path / "plant.csv")
    assert found["reason"].str.contains("plant.csv, torque.csv: .*'much'").tolist() == [True, False]


def test_answers_become_a_trend_for_each_joint(dated, tmp_path):
    answers = backlash.estimate_many(dated, **HOW)
    answers.to_parquet(tmp_path / "answers.parquet")
    found = backlash.trend_many(pd.read_parquet(tmp_path / "answers.parquet"), limit_rad=1.5e-3)
    assert list(found) == ["A1", "A2"]
    assert found["A2"].line[1] > 2 * found["A1"].line[1]
    worn = pd.read_csv(dated).query("joint == 'A2'")
    logs = [dated.with_name(name) for name in worn["file"]]
    alone = backlash.trend(logs, worn["date"].tolist(), limit_rad=1.5e-3, **HOW)
    assert found["A2"].to_dict() == alone.to_dict()
    few = backlash.trend_many(answers.iloc[:4])
    assert str(few["A1"]) == "2 dates with an estimate; a trend needs 3 or more"


@pytest.mark.slow
def test_a_backend_that_gives_lists_only_is_enough():
    logs = [table(noisy(seed=k)) for k in range(3)]
    with joblib.parallel_config(backend="multiprocessing"):
        found = backlash.estimate_many(logs, jobs=2, **HOW)
    pd.testing.assert_frame_equal(found, backlash.estimate_many(logs, jobs=1, **HOW))


def test_answers_that_a_full_disk_does_not_take_are_printed_and_the_next_run_has_them(
    dated, tmp_path, capsys, monkeypatch
):
    def full(path, content):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def raised(error):
        raise error

    out = tmp_path / "answers.csv"
    line = f"estimate --batch {dated} --turn-period 0.4 --method energy --out {out}"
    with monkeypatch.context() as disk:
        disk.setattr(commands, "write_csv", full)
        disk.setattr("backlash.main.ending", raised)
        with pytest.raises(OSError, match="device: 8 of 8 answers are"):
            command(line)
    assert len(json.loads(capsys.readouterr().out)) == 8
    monkeypatch.setattr("backlash.fleet.examine", None)
    assert command(line) == 0
    assert len(pd.read_csv(out)) == 8
    assert not out.with_name("answers.csv.kept").exists()


@pytest.mark.slow
def test_a_dask_cluster_that_loses_a_worker_answers_every_log(tmp_path):
    import distributed  # half a second

    log = write(noisy(), tmp_path / "0.csv")
    logs = [str(log), *(shutil.copy(log, str(tmp_path / f"{k}.csv")) for k in range(1, 200))]
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as local,
        distributed.Client(local) as client,
    ):
        [first, _] = client.run(os.getpid).values()
        found = {}
        with joblib.parallel_config(backend="dask"):
            for number, answer in fleet.run_fleet(
                logs, [settings_for(TURN, method="energy")] * 200
            ):
                if len(found) == 20:
                    os.kill(first, signal.SIGKILL)
                found[number] = answer
    assert {found[k].file for k in range(200)} == {*logs}
    assert {answer.verdict for answer in found.values()} == {"backlash"}
