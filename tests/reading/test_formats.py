import gzip
import sys

import numpy as np
import pandas as pd
import pytest

from backlash.reading import sources
from backlash.reading.prepare import open_log
from tests.logs import TURN, file, noisy, refusal


def test_what_a_compressed_text_unpacks_to_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(sources, "MOST_BYTES", 2**16)
    path = file(tmp_path, gzip.compress(b"1,2\n" * 2**20))
    assert path.stat().st_size < 2**16
    assert "MiB that are read; cut it to the test movement" in refusal(path)


@pytest.mark.parametrize(
    "first",
    [b"\x89HDF\r\n\x1a\n", b"MATLAB 5.0", b"MDF     4.10", b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n"],
)
def test_a_recorders_own_format_is_refused_with_what_to_do(first, tmp_path):
    path = file(tmp_path, first + bytes(100))
    assert "export the log as CSV, or hand its columns over from Python" in refusal(path)


def test_a_missing_library_is_named_with_what_installs_it_and_a_broken_file_as_broken(
    tmp_path, monkeypatch
):
    path = file(tmp_path, b"PAR1" + bytes(100))
    with monkeypatch.context() as patch:
        for name in [name for name in sys.modules if name.split(".")[0] == "pyarrow"]:
            patch.delitem(sys.modules, name)
        patch.setitem(sys.modules, "pyarrow", None)
        assert "pip install 'backlash-replication[parquet]'" in refusal(path)
    pytest.importorskip("pyarrow", reason="reading Parquet needs the extra 'parquet'")
    assert "a broken Parquet file" in refusal(path)


# ---------------------------------------------------------------------------------------------------------------
# Time stamps, and tables of another shape


@pytest.mark.parametrize(("power", "unit"), [(9, "ns"), (6, "us"), (3, "ms"), (0, None)])
def test_stamps_since_1970_are_read_by_their_size(power, unit):
    stamps = 10**power * (1_710_000_000 + noisy().t.astype("longdouble"))
    stamps = np.rint(stamps).astype("int64") if power else stamps.astype(float)
    log = open_log(pd.DataFrame({"timestamp": stamps, "speed_rps": noisy().v}), TURN)
    np.testing.assert_allclose(log.recording.v, noisy().v, atol=1e-4)
    np.testing.assert_allclose(log.recording.t, noisy().t, atol=1e-6)
    assert log.notes == ((f"time stamps read in {unit}",) if unit else ())


def test_of_a_robots_joints_the_user_is_asked_for_one():
    frame = pd.DataFrame({"__time": noisy().t, "dq[0]": noisy().v, "dq[1]": -noisy().v})
    assert "which column is the speed: 'dq[0]', 'dq[1]'? give --speed" in refusal(frame)
