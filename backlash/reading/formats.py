"""Logs of measuring systems and robots: each kind of file through the library that is made for it."""

import gc
import json
from collections.abc import Callable, Iterable, Mapping
from contextlib import redirect_stderr
from dataclasses import asdict
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

Check = Callable[[int, int], None]  # refuses too many rows or columns
Reader = Callable[[Path, Check], pd.DataFrame]
_WIDEST = 64  # of an array that may hold signals


def read_parquet(path: Path, check: Check) -> pd.DataFrame:
    """Read the numbers of a Parquet file; text and nested columns hold no speed, and may unpack to anything."""
    from pyarrow.parquet import ParquetFile

    numeric = ("int", "uint", "float", "double", "halffloat", "timestamp", "decimal")
    with ParquetFile(path) as file:
        flat = [field.name for field in file.schema_arrow if str(field.type).startswith(numeric)]
        check(file.metadata.num_rows, len(flat))
        return file.read(columns=flat).to_pandas(ignore_metadata=True)


def read_hdf5(path: Path, check: Check) -> pd.DataFrame:
    """Read the arrays of one length in an HDF5 file, of MATLAB 7.3 too; what lies in other files is left out."""
    import h5py

    arrays = {}

    def collect(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset) and node.shape and not node.is_virtual and not node.external:
            check(max(node.shape), 1)
            unit = node.attrs.get("units", node.attrs.get("unit"))
            if node.ndim == 1 or sorted(node.shape)[-2] <= _WIDEST:
                arrays[f"{name} [{unit}]" if unit else name] = node[()]

    with h5py.File(path) as file:
        file.visititems(collect)
    return _of_one_length(arrays)


def read_matlab(path: Path, check: Check) -> pd.DataFrame:
    """Read the arrays of one length in an older MATLAB file, those in its structures too."""
    from scipy.io import loadmat

    flat = pd.json_normalize(loadmat(path, simplify_cells=True))
    return _of_one_length({name: np.asarray(flat[name][0]) for name in flat if not name.startswith("__")})


def _of_one_length(arrays: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """Columns from the arrays of numbers that have the greatest length which two columns share."""
    fields = {f"{name} {field}": array[field] for name, array in arrays.items() for field in array.dtype.names or ()}
    flat = {name: np.squeeze(array) for name, array in {**arrays, **fields}.items()}
    columns = _columns({name: a.T if a.ndim == 2 and a.shape[0] < a.shape[1] else a for name, a in flat.items()})
    sizes = [column.size for column in columns.values()]
    length = max((size for size in sizes if sizes.count(size) > 1), default=0)
    return pd.DataFrame({name: column for name, column in columns.items() if column.size == length})


def _columns(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays of numbers, those of several columns one by one."""
    columns = {}
    for name, array in arrays.items():
        if array.dtype.kind in "iuf" and array.ndim == 1:
            columns[name] = array
        elif array.dtype.kind in "iuf" and array.ndim == 2 and array.shape[1] <= _WIDEST:
            columns |= {f"{name}[{k}]": part for k, part in enumerate(array.T)}
    return columns


def read_mdf(path: Path, check: Check) -> pd.DataFrame:
    """Read the channels of an MDF file (ASAM), each at its own stamps."""
    from asammdf import MDF

    opened, problem = None, ""
    try:
        opened = MDF(path)
    except Exception as error:
        problem = str(error)
    if opened is None:
        with redirect_stderr(StringIO()):  # where asammdf prints a traceback when what it could not open is deleted
            gc.collect()
        raise ValueError(problem)
    with opened as file:
        check(max((group.channel_group.cycles_nr for group in file.groups), default=0), 1)
        signals = [part for part in file.iter_channels() if part.samples.ndim == 1 and part.samples.dtype.kind in "iuf"]
    names = [f"{part.name} [{part.unit}]" if part.unit else part.name for part in signals]
    columns = zip(names, signals, strict=True)
    return _side_by_side([pd.Series(part.samples, part.timestamps, name=name) for name, part in columns], "time [s]")


def _side_by_side(parts: Iterable[pd.Series | pd.DataFrame], time: str) -> pd.DataFrame:
    """Signals joined by their stamps."""
    unique = [part[~part.index.duplicated()] for part in parts]
    return pd.concat(unique, axis=1).sort_index().rename_axis(time).reset_index()


def read_mcap(path: Path, check: Check) -> pd.DataFrame:
    """Read the messages of an MCAP file, in JSON or else of ROS 2."""
    from mcap.reader import make_reader

    def messages() -> Iterable[tuple[str, int, Any]]:
        with path.open("rb") as file:
            for _, channel, message in make_reader(file).iter_messages():
                if channel.message_encoding == "json":
                    yield channel.topic, message.log_time, json.loads(message.data)

    found = _of_messages(messages(), check)
    return read_rosbag(path, check) if found.empty else found


def read_rosbag(path: Path, check: Check) -> pd.DataFrame:
    """Read the messages of a ROS bag, of either version."""
    from rosbags.highlevel import AnyReader

    def messages() -> Iterable[tuple[str, int, Any]]:
        with AnyReader([path]) as reader:
            for connection, stamp_ns, content in reader.messages():
                yield connection.topic, stamp_ns, asdict(reader.deserialize(content, connection.msgtype))

    return _of_messages(messages(), check)


def _of_messages(messages: Iterable[tuple[str, int, Any]], check: Check) -> pd.DataFrame:
    """Columns of the numbers in messages, at the stamps of their headers, else at those of the recorder."""
    topics: dict[str, list[dict]] = {}
    for count, (topic, stamp_ns, message) in enumerate(messages):
        check(count, 1)
        topics.setdefault(topic, []).append({"recorded_ns": stamp_ns} | message)
    frames = [pd.DataFrame()]
    for topic, rows in topics.items():
        flat = pd.json_normalize(rows)
        stamps = flat.pop("recorded_ns")
        if "header.stamp.sec" in flat:
            stamps = 10**9 * flat.pop("header.stamp.sec") + flat.pop("header.stamp.nanosec")
        even = [name for name in flat if flat[name].map(np.size).nunique() == 1]
        columns = _columns({f"{topic}.{name}": np.array(flat[name].tolist()) for name in even})
        frames.append(pd.DataFrame(columns, index=stamps.to_numpy()))
    return _side_by_side(frames, "time [ns]")
