import gzip
import json
import subprocess
import sys
from dataclasses import replace
from io import BytesIO, TextIOWrapper

import numpy as np
import pandas as pd
import pytest
from plain_logs import TURN, plain, read, refusal, text

from backlash.logs import open_log
from backlash.reading import tables
from backlash.reading.prepare import record_of
from replication.recording import Recording
from workbook import ROOT


def assert_is_plain(record: Recording, atol: float = 1e-4):
    np.testing.assert_allclose(record.v, plain().v, atol=atol)
    np.testing.assert_allclose(record.t, plain().t, atol=1e-6)


def test_a_compressed_text_is_read_and_a_broken_one_refused(tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(text().encode()))
    assert_is_plain(read(path))
    path.write_bytes(path.read_bytes()[:-5000])
    assert "cannot be read (Compressed file ended before" in refusal(path)


def test_what_a_compressed_text_unpacks_to_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "MOST_BYTES", 2**16)
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(b"1,2\n" * 2**20))
    assert path.stat().st_size < 2**16
    assert "MiB that are read; cut it to the test movement" in refusal(path)


def test_text_is_read_from_standard_input(monkeypatch):
    monkeypatch.setattr(sys, "stdin", TextIOWrapper(BytesIO(text().encode())))
    assert_is_plain(open_log("-", TURN).recording)


@pytest.mark.parametrize("folder", ["", "measured/axis 4/"])
def test_hdf5_is_read_by_its_arrays_of_one_length(folder, tmp_path):
    h5py = pytest.importorskip("h5py", reason="reading HDF5 needs the extra 'hdf5'")
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file[f"{folder}time"] = plain().t
        file[f"{folder}speed"] = 60 * plain().v
        file[f"{folder}speed"].attrs["unit"] = "rpm"
        file["parameters"], file["picture"] = np.arange(3.0), np.zeros((200, 300))
    assert_is_plain(read(path))


def test_a_table_in_hdf5_is_read_by_its_fields(tmp_path):
    h5py = pytest.importorskip("h5py", reason="reading HDF5 needs the extra 'hdf5'")
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["log"] = np.array(list(zip(plain().t, plain().v, strict=True)), dtype=[("time", "f8"), ("speed", "f8")])
    assert_is_plain(read(path))


def test_matlab_7_3_is_read_as_hdf5(tmp_path):
    h5py = pytest.importorskip("h5py", reason="reading MATLAB 7.3 needs the extra 'hdf5'")
    path = tmp_path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["log/t"], file["log/velocity"] = plain().t[None, :], plain().v[None, :]
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    assert_is_plain(read(path))


def test_links_to_other_files_are_not_followed(tmp_path):
    h5py = pytest.importorskip("h5py", reason="reading HDF5 needs the extra 'hdf5'")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["time"], file["speed"] = plain().t, plain().v
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["time"], file["speed"] = (h5py.ExternalLink("other.h5", name) for name in ("time", "speed"))
    assert "no two columns of numbers" in refusal(tmp_path / "log.h5")


@pytest.mark.parametrize("in_structure", [False, True])
def test_older_matlab_files_are_read(in_structure, tmp_path):
    from scipy.io import savemat

    path = tmp_path / "log.mat"
    content = {"time": plain().t, "speed_rad_s": 2 * np.pi * plain().v}
    savemat(path, {"log": content, "gain": 3.0} if in_structure else content)
    assert_is_plain(read(path))


def test_mdf_is_read_with_its_units_though_other_channels_have_other_stamps(tmp_path):
    asammdf = pytest.importorskip("asammdf", reason="reading MDF needs the extra 'mdf'")
    path = tmp_path / "log.mf4"
    speed = asammdf.Signal(60 * plain().v, plain().t, unit="1/min", name="motor_speed")
    slow = asammdf.Signal(np.arange(50.0), 0.1 * np.arange(50) + 1e-4, unit="K", name="temperature")
    with asammdf.MDF() as file:
        file.append([speed])
        file.append([slow])
        file.save(path)
    assert_is_plain(read(path))


def joint_states():
    """Messages with the instants [ns] at which a recorder got them, late by up to a millisecond."""
    late = np.random.default_rng(2).integers(0, 10**6, plain().t.size)
    for t, v, after in zip(plain().t, plain().v, late, strict=True):
        stamp = 1_710_000_000_000_000_000 + round(1e9 * t)
        yield stamp, stamp + int(after), 2 * np.pi * float(v)


def test_json_in_an_mcap_is_read(tmp_path):
    pytest.importorskip("mcap", reason="reading MCAP needs the extra 'mcap'")
    from mcap.writer import Writer

    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("drive", "jsonschema", b"{}")
        channel = writer.register_channel("drive", "json", schema)
        for stamp, _, speed in joint_states():
            writer.add_message(channel, stamp, json.dumps({"state": "moving", "speed_rad_s": speed}).encode(), stamp)
        writer.finish()
    assert_is_plain(read(path))


@pytest.mark.parametrize("kind", ["log.bag", "log.db3", "log.mcap"])
def test_joint_states_of_ros_are_read_at_the_stamps_of_their_headers(kind, tmp_path):
    pytest.importorskip("rosbags", reason="reading ROS bags needs the extra 'ros'")
    pytest.importorskip("mcap", reason="reading MCAP needs the extra 'mcap'")
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "log.bag" else Stores.ROS2_HUMBLE)
    name = "sensor_msgs/msg/JointState"
    header_of, state_of = store.types["std_msgs/msg/Header"], store.types[name]
    stamp_of, empty = store.types["builtin_interfaces/msg/Time"], np.array([])
    storage = rosbag2.StoragePlugin.MCAP if kind == "log.mcap" else rosbag2.StoragePlugin.SQLITE3
    with (
        rosbag1.Writer(tmp_path / kind)
        if kind == "log.bag"
        else rosbag2.Writer(tmp_path / "log", version=9, storage_plugin=storage)
    ) as writer:
        connection = writer.add_connection("/joint_states", name, typestore=store)
        serialize = store.serialize_ros1 if kind == "log.bag" else store.serialize_cdr
        for stamp, received, speed in joint_states():
            number = {"seq": 0} if kind == "log.bag" else {}
            header = header_of(stamp=stamp_of(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="", **number)
            state = state_of(header=header, name=["a"], position=empty, velocity=np.array([speed]), effort=empty)
            writer.write(connection, received, serialize(state, name))
    assert_is_plain(read(next(tmp_path.rglob(kind)), replace(TURN, unit="rad/s")))


@pytest.mark.parametrize(
    ("content", "kind", "module", "extra"),
    [
        (b"\x89HDF\r\n\x1a\n", "HDF5", "h5py", "hdf5"),
        (b"MATLAB 7.3 MAT-file", "MATLAB", "h5py", "hdf5"),
        (b"MDF     4.10", "MDF", "asammdf", "mdf"),
        (b"\x89MCAP0\r\n", "MCAP", "mcap", "mcap"),
        (b"#ROSBAG V2.0\n", "ROS bag", "rosbags", "ros"),
        (b"SQLite format 3\0", "ROS bag", "rosbags", "ros"),
        (b"PAR1", "Parquet", "pyarrow", "fleet"),
    ],
)
def test_a_missing_library_is_named_with_what_installs_it_and_a_broken_file_as_broken(
    content, kind, module, extra, tmp_path, monkeypatch
):
    path = tmp_path / ("log.bag" if kind == "ROS bag" else "log")
    path.write_bytes(content + bytes(100))
    with monkeypatch.context() as patch:
        for name in [name for name in sys.modules if name.split(".")[0] == module]:
            patch.delitem(sys.modules, name)
        patch.setitem(sys.modules, module, None)
        line = refusal(path)
    assert f"reading {kind} needs {module}" in line
    assert f"pip install 'backlash-replication[{extra}]'" in line
    pytest.importorskip(module, reason=f"reading {kind} needs the extra {extra!r}")
    assert f"a broken {kind} file" in refusal(path)


def test_a_broken_mdf_file_leaves_no_traceback_of_its_library_behind(tmp_path):
    pytest.importorskip("asammdf", reason="reading MDF needs the extra 'mdf'")
    path = tmp_path / "log.mf4"
    path.write_bytes(b"MDF     4.10" + bytes(9))
    command = [sys.executable, "-m", "backlash", "estimate", str(path), "--turn-period", "0.4"]
    said = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert said.returncode == 2
    assert "Traceback" not in said.stderr
    assert "a broken MDF file" in said.stderr


def test_a_broken_older_matlab_file_is_refused(tmp_path):
    path = tmp_path / "log.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x01IM" + bytes(range(200)))
    assert "a broken MATLAB file" in refusal(path)


# ---------------------------------------------------------------------------------------------------------------
# Time stamps, and tables of another shape


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("Zeit;Drehzahl [U/min]", "17.03.2024 12:00:0{t:.3f};{rpm:.3f}"),
        ("time;speed", "12:00:0{t:.3f};{v:.5f}"),
    ],
)
def test_dates_and_numbers_with_decimal_commas_are_read(header, row, tmp_path):
    path = tmp_path / "log.csv"
    dates, dots = text(header, row), "17.03.2024"
    path.write_text(dates.replace(dots, "@").replace(".", ",").replace("@", dots), encoding="utf-8")
    assert_is_plain(read(path))


@pytest.mark.parametrize(("power", "unit"), [(9, "ns"), (6, "us"), (3, "ms"), (0, None)])
def test_stamps_since_1970_are_read_by_their_size(power, unit):
    stamps = (
        (10**power * 1_710_000_000 + np.rint(10**power * plain().t).astype("int64")) if power else 1.71e9 + plain().t
    )
    found, notes = record_of(pd.DataFrame({"timestamp": stamps, "speed_rps": plain().v}), TURN, "log")
    assert_is_plain(found)
    assert notes == ((f"time stamps read in {unit}",) if unit else ())


@pytest.mark.parametrize("names", [("sec", "nanosec"), ("secs", "nsecs")])
def test_a_stamp_in_seconds_and_nanoseconds_is_read_as_one(names):
    ns = 1_710_000_000_999_000_000 + np.rint(1e9 * plain().t).astype("int64")
    stamp = {f"header.stamp.{names[0]}": ns // 10**9, f"header.stamp.{names[1]}": ns % 10**9}
    frame = pd.DataFrame({"header.seq": np.arange(ns.size), **stamp, "velocity[0]": plain().v})
    assert_is_plain(record_of(frame, TURN, "log")[0])


def test_of_a_robots_joints_the_user_is_asked_for_one():
    frame = pd.DataFrame({"__time": plain().t, "dq[0]": plain().v, "dq[1]": -plain().v})
    with pytest.raises(tables.UnusableLog, match=r"which column is the speed: 'dq\[0\]', 'dq\[1\]'\? give --speed"):
        record_of(frame, TURN, "log")


@pytest.mark.parametrize("more", ["", ",NaN"])
def test_a_long_table_is_turned(more, tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"{t:.4f},{name},{v}{more}" for t, v in zip(plain().t, plain().v, strict=True)
            for name, v in (("temperature", 20), ("speed [rps]", v))]  # fmt: skip
    path.write_text("\n".join(["time,signal,value" + (",quality" if more else ""), *rows]), encoding="utf-8")
    assert_is_plain(read(path))
    path.write_text("signal,value,v\n" + "\n".join(f"speed,{v},{v}" for v in plain().v), encoding="utf-8")
    assert "no column of time among 'signal', 'value', 'v'; give --time" in refusal(path)
