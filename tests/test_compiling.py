"""Compiled code is kept for our own functions, where it can be, and never for another state of the sources."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from replication import compiling
from replication.files import ROOT

CALLER = """
from replication import compiling, one
print(one.twice(2.0), sum(one.twice.stats.cache_hits.values()), compiling.cache_folder())
"""


@pytest.fixture
def package(tmp_path):
    """A small package with one compiled function that calls another's."""
    room = tmp_path / "site" / "replication"
    room.mkdir(parents=True)
    (room / "__init__.py").touch()
    shutil.copy(ROOT / "replication" / "compiling.py", room)
    start = "from replication.compiling import njit\n"
    (room / "other.py").write_text(f"{start}\n@njit\ndef inner(x):\n    return 2 * x\n")
    (room / "one.py").write_text(
        f"from replication.other import inner\n{start}\n@njit\ndef twice(x):\n    return inner(x)\n"
    )
    return room


def called(package: Path, code: str = CALLER, **environment: str) -> list[str]:
    """What a new process prints: by itself a result, how much of it was compiled before, and where that is kept."""
    site = package.parent
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
    (package / "__pycache__").touch()  # no folder can be made of it
    assert called(package)[2].startswith(str(package.parent / "home" / ".cache" / "backlash"))
    (tmp_path / "temporary").mkdir()
    nowhere = {"HOME": "/proc/nowhere", "TMPDIR": str(tmp_path / "temporary")}
    assert called(package, **nowhere)[2].startswith(str(tmp_path / "temporary"))
    assert called(package, **nowhere)[:2] == ["4.0", "1"]


def test_a_folder_that_others_may_write_is_not_taken(tmp_path):
    folder = tmp_path / "shared"
    folder.mkdir()
    assert compiling._is_ours(folder)
    folder.chmod(0o777)
    assert not compiling._is_ours(folder)
    assert not compiling._is_ours(Path("/dev/null"))


def test_another_packages_cache_stays_where_numba_keeps_it(package):
    site = package.parent
    (site / "theirs.py").write_text(
        "import numba\n\n@numba.njit(cache=True)\ndef same(x):\n    return x\n"
    )
    shown = "import replication.one, theirs; theirs.same(1.0); print(theirs.same.stats.cache_path)"
    assert called(package, code=shown) == [str(site / "__pycache__")]
