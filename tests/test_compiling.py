"""Compiled code is kept for our own functions, where it can be, and never for another state of the sources."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from replication import compiling
from replication.files import ROOT

CALLER = """
from replication import one
print(one.twice(2.0), sum(one.twice.stats.cache_hits.values()))
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


def called(package: Path, code: str = CALLER) -> list[str]:
    """What a new process prints: by itself a result, and how much of it was compiled before."""
    site = package.parent
    outside = {
        name: value for name, value in os.environ.items() if not name.startswith("NUMBA_CACHE")
    }
    given = outside | {"PYTHONPATH": str(site)}
    command = [sys.executable, "-c", code]
    return subprocess.run(
        command, env=given, cwd=site, capture_output=True, text=True, check=True
    ).stdout.split()


def test_a_second_process_compiles_nothing_and_a_change_in_any_file_that_compiles_everything(
    package,
):
    site, other = package.parent, package / "other.py"
    assert called(package)[:2] == ["4.0", "0"]
    (package / "plain.py").write_text("x = 1")
    (site / "theirs.py").write_text(
        "import numba\n\n@numba.njit(cache=True)\ndef same(x):\n    return x\n"
    )
    shown = "import theirs; theirs.same(1.0); print(theirs.same.stats.cache_path)"
    # Another package's cache stays where numba keeps it.
    assert called(package, CALLER + shown)[1:] == ["1", str(site / "__pycache__")]
    other.write_text(other.read_text().replace("2 * x", "3 * x"))
    assert called(package)[:2] == ["6.0", "0"]


def test_where_the_package_cannot_be_written_the_home_keeps_it_and_else_a_temporary_folder(
    tmp_path, monkeypatch
):
    """A folder that others may write is not taken."""
    (tmp_path / "__pycache__").touch()  # no folder can be made of it
    monkeypatch.setattr(compiling, "_PACKAGE", tmp_path)
    monkeypatch.setattr(compiling.config, "CACHE_DIR", "")
    monkeypatch.setenv("HOME", str(tmp_path))
    found = compiling.cache_folder.__wrapped__
    at_home = found()
    assert at_home.parent == tmp_path / ".cache" / "backlash"
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    at_home.chmod(0o777)
    assert found().parent.parent == tmp_path
    monkeypatch.setenv("HOME", "/proc/nowhere")
    assert found().parent.parent == tmp_path
