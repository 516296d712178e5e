"""Compiled code is kept for our own functions, where it can be, and never for another state of the sources."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from replication.compiled import cache
from replication.files import ROOT

CALLER = """
from replication.compiled import cache, one
print(one.twice(2.0), sum(one.twice.stats.cache_hits.values()), cache.cache_folder())
"""


@pytest.fixture
def package(tmp_path):
    """A small package with one compiled function that calls another's."""
    room = tmp_path / "site" / "replication" / "compiled"
    room.mkdir(parents=True)
    for file in (room.parent / "__init__.py", room / "__init__.py"):
        file.touch()
    shutil.copy(ROOT / "replication" / "compiled" / "cache.py", room)
    start = "from replication.compiled.cache import njit\n"
    (room / "other.py").write_text(f"{start}\n@njit\ndef inner(x):\n    return 2 * x\n")
    (room / "one.py").write_text(
        f"from replication.compiled.other import inner\n{start}\n@njit\ndef twice(x):\n    return inner(x)\n"
    )
    return room


def called(package: Path, code: str = CALLER, **environment: str) -> list[str]:
    """What a new process prints: by itself a result, how much of it was compiled before, and where that is kept."""
    site = package.parents[1]
    outside = {
        name: value for name, value in os.environ.items() if not name.startswith("NUMBA_CACHE")
    }
    given = outside | {"PYTHONPATH": str(site), "HOME": str(site / "home")} | environment
    command = [sys.executable, "-c", code]
    return subprocess.run(
        command, env=given, cwd=site, capture_output=True, text=True, check=True
    ).stdout.split()


def test_a_second_process_compiles_nothing_and_a_change_in_any_file_that_compiles_everything(
    package,
):
    assert called(package)[:2] == ["4.0", "0"]
    assert called(package)[:2] == ["4.0", "1"]
    other = package / "other.py"
    (package / "plain.py").write_text("x = 1")
    assert called(package)[1] == "1"
    other.write_text(other.read_text().replace("2 * x", "3 * x"))
    assert called(package)[:2] == ["6.0", "0"]


def test_where_the_package_cannot_be_written_the_home_keeps_it_and_else_a_temporary_folder(
    package, tmp_path
):
    (package.parent / "__pycache__").touch()  # no folder can be made of it
    assert called(package)[2].startswith(str(package.parents[1] / "home" / ".cache" / "backlash"))
    (tmp_path / "temporary").mkdir()
    nowhere = {"HOME": "/proc/nowhere", "TMPDIR": str(tmp_path / "temporary")}
    assert called(package, **nowhere)[2].startswith(str(tmp_path / "temporary"))
    assert called(package, **nowhere)[:2] == ["4.0", "1"]


def test_a_folder_that_others_may_write_is_not_taken(tmp_path):
    folder = tmp_path / "shared"
    folder.mkdir()
    assert cache._is_ours(folder)
    folder.chmod(0o777)
    assert not cache._is_ours(folder)
    assert not cache._is_ours(Path("/dev/null"))


def test_another_packages_cache_stays_where_numba_keeps_it(package):
    site = package.parents[1]
    (site / "theirs.py").write_text(
        "import numba\n\n@numba.njit(cache=True)\ndef same(x):\n    return x\n"
    )
    shown = "import replication.compiled.one, theirs; theirs.same(1.0); print(theirs.same.stats.cache_path)"
    assert called(package, code=shown) == [str(site / "__pycache__")]


def test_an_array_is_computed_once_and_again_where_it_is_broken(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "cache_folder", lambda: tmp_path)
    computed = []

    def compute():
        computed.append(1)
        return np.arange(3.0)

    for _ in range(2):
        np.testing.assert_array_equal(cache.keep_array(b"inputs", compute), np.arange(3.0))
    cache.keep_array(b"others", compute)
    assert len(computed) == 2
    for kept in tmp_path.iterdir():
        kept.write_bytes(kept.read_bytes()[:50])
    np.testing.assert_array_equal(cache.keep_array(b"inputs", compute), np.arange(3.0))
    monkeypatch.setattr(cache, "cache_folder", lambda: None)
    np.testing.assert_array_equal(cache.keep_array(b"inputs", compute), np.arange(3.0))
    assert len(computed) == 4
