"""A stamp says what a run made: whatever is no longer as it was made is due."""

import subprocess
import sys

import pytest

from workbook import stamps


@pytest.fixture
def run_once(tmp_path):
    """A project in which a run has made two files."""
    files = [tmp_path / "figures" / "one.svg", tmp_path / "results" / "two.csv"]
    for file in files:
        file.parent.mkdir()
        file.write_text("made")
    stamp = tmp_path / ".make" / "small.ran"
    stamp.parent.mkdir()
    stamp.write_bytes(stamps.new_stamp(tmp_path, files, 12.3))
    return tmp_path, stamp


@pytest.mark.parametrize(
    "damage",
    [
        lambda file: file.unlink(),
        lambda file: file.write_text(""),
        lambda file: file.write_text("made by another"),
        lambda file: (file.unlink(), file.mkdir()),
    ],
    ids=["removed", "emptied", "changed", "a folder"],
)
@pytest.mark.parametrize("name", ["figures/one.svg", "results/two.csv"])
def test_a_file_that_is_gone_or_changed_makes_its_run_due(run_once, name, damage):
    project, stamp = run_once
    asked = [sys.executable, "-I", stamps.__file__]
    subprocess.run(asked, cwd=project, check=True)
    assert stamps.read_stamp(stamp)["seconds"] == 12
    damage(project / name)
    assert stamps.changed_files(project, stamp) == [name]
    subprocess.run(asked, cwd=project, check=True)
    assert not stamp.exists()


@pytest.mark.parametrize("text", ["", "12\n", "{", '{"seconds": 1, "made": {}}'])
def test_a_stamp_that_says_nothing_is_none(run_once, text):
    project, stamp = run_once
    stamp.write_text(text)
    stamps.drop_outdated(project)
    assert not stamp.exists()
