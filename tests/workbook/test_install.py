"""Installation: a user's variables say where packages come from, and no more; a stamp says what can be imported."""

import fcntl
import os
import re
import sys
import tomllib
import venv
from unittest.mock import Mock, call

import pytest

from replication.files import write_text
from workbook import ROOT, install


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder to install into."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pyproject.toml").write_text('[dependency-groups]\none = ["broken>=1"]\n')
    (tmp_path / "requirements.lock").write_text("broken==1.0 \\\n    --hash=sha256:00\n")
    return tmp_path


def add_package(name, version, module="broken.py"):
    """Install a package whose import fails into .venv."""
    about = install.SITE / f"{name}-{version}.dist-info"
    write_text(about / "METADATA", f"Name: {name}\nVersion: {version}\n")
    write_text(about / "RECORD", f"{module},,\n")
    write_text(install.SITE / module, "1 / 0")


@pytest.mark.parametrize("is_there", [True, False])
def test_where_no_pip_is_there_the_environment_gets_its_own(is_there, monkeypatch):
    ran = Mock(return_value=True)
    monkeypatch.setattr(install, "find_spec", lambda name: is_there)
    monkeypatch.setattr(install, "run", ran)
    python, *words = install.pip.__wrapped__()
    assert python == (sys.executable if is_there else install.PYTHON)
    assert words[3:] == (["--python", install.PYTHON] if is_there else [])
    assert ran.called != is_there


def test_of_a_users_variables_only_where_packages_come_from_is_kept(monkeypatch):
    kept = {"PIP_CERT": "a", "PIP_INDEX_URL": "b", "UV_INDEX_STRATEGY": "c", "HOME": "d"}
    dropped = {"PIP_TARGET", "PIP_USER", "UV_NO_DEPS", "UV_PYTHON", "VIRTUAL_ENV", "PYTHONPATH"}
    for name, value in (kept | dict.fromkeys(dropped, "/elsewhere")).items():
        monkeypatch.setenv(name, value)
    assert kept.items() <= install.environment().items()
    assert not dropped & install.environment().keys()


@pytest.mark.parametrize("module", ["broken.py", "broken/__init__.py"])
def test_what_is_promised_is_looked_for_in_the_locked_version_and_imported(folder, module):
    venv.create(".venv", symlinks=True)
    assert install.find_lacking("one") == "broken is not there in the locked version"
    add_package("broken", "1.0", module)
    assert install.find_lacking("one").startswith("broken cannot be imported (ZeroDivisionError")
    (install.SITE / module).write_text("")
    assert install.find_lacking("one") == ""
    (folder / "requirements.lock").write_text("broken==1.0.1\n")
    assert install.find_lacking("one") == "broken is not there in the locked version"


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
    for name in ("numpy", "Some_Tool"):
        add_package(name, "2.0")
    (folder / "disk" / install.MARK).write_text("numpy==2.0 \\\n    --hash=sha256:00\n")
    install.clear_environment()
    assert capsys.readouterr().out == "Packages that were added to .venv by hand go: some-tool\n"
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
    assert installs.call_args == call(install.BASE)
    assert stamp.stat().st_mtime == 2**32  # or all would be installed again
    installs.reset_mock()
    install.SITE.rmdir()
    install.main(stamp)
    assert installs.called


def test_a_stamp_is_set_only_where_what_it_promises_is_there(installed, monkeypatch):
    _, stamp = installed
    stamp.unlink()
    monkeypatch.setattr(install, "find_lacking", lambda group: f"{group} is not there")
    with pytest.raises(SystemExit, match=r"^\.venv: workbook is not there; .*$"):
        install.main(stamp)
    assert not stamp.exists()
    monkeypatch.setattr(install, "find_lacking", lambda group: "")
    install.main(stamp)
    assert stamp.exists()


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


def test_every_group_of_the_project_is_in_the_lock():
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["dependency-groups"]
    lock = (ROOT / "requirements.lock").read_text("utf-8")
    of_uv, others = install.split_lock(lock)
    assert of_uv.startswith("uv==")
    assert sorted((of_uv + others).splitlines()) == sorted(lock.splitlines())
    asked = [each for group in groups for each in install.in_group(groups, group)]
    names = {re.match("[A-Za-z0-9-]+", each)[0].lower() for each in asked}
    assert names <= {*re.findall(r"(?m)^(.+)==", lock)}
