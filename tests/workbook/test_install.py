"""Installation: only an environment that is ours is replaced, and a stamp says what is there in the locked version."""

import fcntl
import os
import re
import tomllib
from unittest.mock import Mock, call

import pytest

from replication.files import write_text
from workbook import ROOT, install


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder to install into."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pyproject.toml").write_text(
        '[dependency-groups]\none = ["some-tool>=1", "other; x", {include-group = "two"}]\n'
    )
    (tmp_path / "requirements.lock").write_text("some-tool==1.0 \\\n    --hash=sha256:00\n")
    return tmp_path


def add_package(name, version):
    """Install a package into .venv, by what says that it is there."""
    about = install.SITE / f"{name}-{version}.dist-info"
    write_text(about / "METADATA", f"Name: {name}\nVersion: {version}\n")


def test_what_is_promised_is_looked_for_in_the_locked_version(folder):
    assert install.find_lacking("one") == "some-tool"
    add_package("Some_Tool", "1.0")
    assert install.find_lacking("one") == ""
    (folder / "requirements.lock").write_text("some-tool==1.0.1\n")
    assert install.find_lacking("one") == "some-tool"


NOT_OURS = {
    "another's": lambda: write_text(install.VENV / "notes.txt", "mine"),
    "a file": lambda: install.VENV.touch(),
    "a link to nowhere": lambda: install.VENV.symlink_to("nowhere"),
}


@pytest.mark.parametrize("make", NOT_OURS.values(), ids=NOT_OURS)
def test_an_environment_that_is_not_ours_is_left_as_it_is(folder, make):
    make()
    before = sorted(folder.rglob("*"))
    with pytest.raises(SystemExit, match=r"^\.venv: not made by this Makefile"):
        install.clear_environment()
    assert sorted(folder.rglob("*")) == before


def test_ours_is_emptied_also_behind_a_link_and_what_was_added_by_hand_is_named(folder, capsys):
    (folder / "disk").mkdir()
    (folder / ".venv").symlink_to("disk")
    for name in ("numpy", "Some_Tool", "pip"):
        add_package(name, "2.0")
    install.MARK.write_text("numpy==2.0 \\\n    --hash=sha256:00\n")
    install.clear_environment()
    says = "Packages that were added to .venv by hand go: some-tool==2.0\n"
    assert capsys.readouterr().out == says
    assert (folder / ".venv").is_symlink()
    assert [*(folder / "disk").iterdir()] == []
    install.clear_environment()


@pytest.fixture
def installed(folder, monkeypatch):
    """Stand-ins of what installs, whether it was called; and a stamp of an earlier installation."""
    installs = Mock()
    for name in ("make_environment", "install"):
        monkeypatch.setattr(install, name, installs)
    monkeypatch.setattr(install, "find_lacking", lambda group: "")
    install.SITE.mkdir(parents=True)
    stamp = install.VENV / ".installed"
    stamp.touch()
    return installs, stamp


def test_the_environment_is_made_again_where_a_file_is_newer_or_python_is_another(installed):
    installs, stamp = installed
    install.main(stamp)
    assert not installs.called
    os.utime("requirements.lock", (2**32, 2**32))
    install.main(stamp)
    assert installs.mock_calls == [call(), call("workbook")]
    assert stamp.stat().st_mtime == 2**32  # or all would be installed again
    installs.reset_mock()
    install.SITE.rmdir()
    install.main(stamp)
    assert installs.called


def test_a_stamp_is_set_only_where_what_it_promises_is_there(installed, monkeypatch):
    _, stamp = installed
    stamp.unlink()
    monkeypatch.setattr(install, "find_lacking", lambda group: group)
    with pytest.raises(SystemExit, match=r"^\.venv: workbook is not there in the locked version"):
        install.main(stamp)
    assert not stamp.exists()


def test_a_second_make_waits_and_finds_what_the_first_has_installed(installed, monkeypatch, capsys):
    installs, stamp = installed
    os.utime("pyproject.toml", (2**32, 2**32))

    def lock(file, how):
        if how & fcntl.LOCK_NB:
            raise BlockingIOError
        os.utime(stamp, (2**32, 2**32))

    monkeypatch.setattr(fcntl, "flock", lock)
    install.main(stamp)
    assert "waiting" in capsys.readouterr().out
    assert not installs.called


def test_what_sends_packages_elsewhere_reaches_no_installer(monkeypatch):
    monkeypatch.setenv("PIP_TARGET", "elsewhere")
    monkeypatch.setenv("PIP_PROXY", "a-proxy")
    assert install.run(["sh", "-c", '[ "$PIP_TARGET$PIP_PROXY" = a-proxy ]'])


def test_every_group_of_the_project_is_in_the_lock_and_what_pip_gets_is_all_but_uv():
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["dependency-groups"]
    asked = {each for group in groups.values() for each in group if isinstance(each, str)}
    lock = (ROOT / "requirements.lock").read_text("utf-8")
    locked = re.findall(r"(?m)^(.+)==", lock)
    assert {re.match("[A-Za-z0-9-]+", each)[0].lower() for each in asked} <= {*locked}
    parts = ["".join(install.OF_UV.findall(lock)), install.OF_UV.sub("", lock)]
    of_uv, others = (re.findall(r"(?m)^(.+)==", part) for part in parts)
    assert of_uv == ["uv"]
    assert others == [name for name in locked if name != "uv"]
