"""Installation: a user's settings say where packages come from, and no more; a stamp says what can be imported."""

import fcntl
import os
import subprocess
import sys
import tomllib
import venv
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from unittest.mock import Mock

import packaging
import pytest

from workbook import ROOT, install


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder to install into, for a user without settings."""
    monkeypatch.chdir(tmp_path)
    for name in os.environ:
        if name.startswith(("PIP_", "UV_", "XDG_")):
            monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(install, "PYTHON", sys.executable)
    return tmp_path


PIP_CONF = """[global]
index-url = https://index.example/simple
proxy = http://proxy.example:3128
[install]
target = /elsewhere
no-deps = true
prefix = /elsewhere
"""
UV_TOML = """index-url = "https://index.example/simple"
native-tls = true
[[index]]
name = "second"
url = "https://second.example/simple"
[pip]
target = "/elsewhere"
no-deps = true
extra-index-url = ["https://third.example/simple"]
"""


def of_any_python():
    """The command pip of the Python that .venv was made by, for .venv need have none."""
    python = f"{sys.base_prefix}/bin/python3"
    if subprocess.run([python, "-c", "import pip"], capture_output=True).returncode:
        pytest.skip("needs pip")
    return [python, "-m", "pip"]


@pytest.mark.parametrize(("there", "is_own"), [("22.3.1", False), ("22.2", True), (None, True)])
def test_where_no_pip_is_there_that_installs_for_another_python_the_environment_gets_its_own(
    there, is_own, monkeypatch
):
    versions = Mock(return_value=there, side_effect=None if there else PackageNotFoundError)
    ran = Mock(return_value=True)
    monkeypatch.setattr(install, "version", versions)
    monkeypatch.setattr(install, "run", ran)
    python, *words = install.pip.__wrapped__()
    assert python == (install.PYTHON if is_own else sys.executable)
    assert words[:3] == ["-I", "-m", "pip"]
    assert words[3:] == ([] if is_own else ["--python", install.PYTHON])
    assert ran.called == is_own


def test_of_pips_settings_only_where_packages_come_from_is_kept(folder, monkeypatch):
    (folder / "pip.conf").write_text(PIP_CONF)
    settings = {"PIP_CONFIG_FILE": str(folder / "pip.conf"), "PIP_CERT": "/certificates.pem"}
    settings |= {"PIP_ROOT": "/elsewhere", "PIP_DRY_RUN": "1", "PIP_TARGET": "/elsewhere"}
    settings |= {"VIRTUAL_ENV": "/elsewhere", "PYTHONUSERBASE": "/elsewhere"}
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(install, "pip", of_any_python)
    variables = install.environment() | install.pip_settings()
    assert "/elsewhere" not in variables.values()
    kept = {"PIP_INDEX_URL": "https://index.example/simple", "PIP_CERT": "/certificates.pem"}
    kept |= {"PIP_PROXY": "http://proxy.example:3128", "PIP_CONFIG_FILE": os.devnull}
    assert kept.items() <= variables.items()
    assert not {"PIP_NO_DEPS", "PIP_PREFIX", "PIP_TARGET", "PIP_ROOT"} & {*variables}


@pytest.mark.parametrize("place", [".config/uv/uv.toml", "named.toml"])
def test_of_uvs_settings_only_where_packages_come_from_is_kept(folder, place, monkeypatch):
    file = folder / place
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(UV_TOML)
    if place == "named.toml":
        monkeypatch.setenv("UV_CONFIG_FILE", str(file))
    monkeypatch.setenv("UV_INDEX_STRATEGY", "first-index")
    monkeypatch.setenv("UV_NO_DEPS", "1")
    kept = tomllib.loads(install.uv_settings())
    assert kept == {
        "index-url": "https://index.example/simple",
        "native-tls": True,
        "index": [{"name": "second", "url": "https://second.example/simple"}],
        "extra-index-url": ["https://third.example/simple"],
    }
    of_uv = {name for name in install.environment() if name.startswith("UV_")}
    assert of_uv == {"UV_INDEX_STRATEGY"}


def test_a_settings_file_that_cannot_be_read_ends_it_in_one_line(folder, monkeypatch):
    (folder / "torn").write_text("[global\n")
    monkeypatch.setenv("PIP_CONFIG_FILE", str(folder / "torn"))
    monkeypatch.setenv("UV_CONFIG_FILE", str(folder / "torn"))
    monkeypatch.setattr(install, "pip", of_any_python)
    for read in (install.pip_settings, install.uv_settings):
        with pytest.raises(SystemExit, match="torn") as ended:
            read()
        assert "\n" not in str(ended.value)


@pytest.mark.parametrize(
    ("requirement", "locked", "lacks"),
    [
        ("numpy>=2", "numpy==0.0.1", "numpy is there as .*, not 0.0.1"),
        ("no-such-package", "", "no-such-package is not there"),
        ("pandas[excel]", "", ".* is not there"),
        ("pandas", 'numpy==0.0.1 ; python_version < "3"', ""),
    ],
)
def test_what_is_promised_is_looked_for_in_the_locked_version_with_all_that_it_needs(
    folder, requirement, locked, lacks
):
    groups = {"base": ["pytest"], "one": [{"include-group": "base"}, requirement]}
    text = "".join(f"{name} = {install._as_toml(value)}\n" for name, value in groups.items())
    (folder / "pyproject.toml").write_text(f"[dependency-groups]\n{text}")
    (folder / "requirements.lock").write_text(f"{locked} \\\n    --hash=sha256:00\n")
    found = install.find_lacking(["one"], is_base=False)
    assert install.re.fullmatch(lacks, found)


@pytest.mark.parametrize("module", ["broken.py", "broken/__init__.py", "broken.abi3.so"])
def test_what_is_there_and_cannot_be_imported_is_named(folder, module, monkeypatch):
    venv.create(folder / ".venv", symlinks=True)
    (site,) = folder.glob(".venv/lib/python*/site-packages")
    (site / "packaging").symlink_to(Path(packaging.__file__).parent)
    about = site / "broken-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Name: broken\nVersion: 1.0\n")
    (about / "RECORD").write_text(f"{module},,\n")
    (site / module).parent.mkdir(exist_ok=True)
    (site / module).write_text("1 / 0")
    (folder / "pyproject.toml").write_text('[dependency-groups]\none = ["broken"]\n')
    (folder / "requirements.lock").write_text("")
    monkeypatch.setattr(install, "PYTHON", str(folder / ".venv" / "bin" / "python"))
    assert install.find_lacking(["one"], is_base=False).startswith("broken cannot be imported")


@pytest.mark.slow
def test_an_installer_that_ends_well_and_installs_nothing_sets_no_stamp(folder):
    (folder / "bin").mkdir()
    for name in ("uv", "pip"):
        (folder / "bin" / name).write_text("#!/bin/sh\nexit 0\n")
        (folder / "bin" / name).chmod(0o755)
    for name in ("pyproject.toml", "requirements.lock", "workbook", "replication"):
        (folder / name).symlink_to(ROOT / name)
    ended = subprocess.run(
        [sys.executable, "-m", "workbook.install", ".venv/.installed"],
        env=os.environ | {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 1
    assert ended.stderr.startswith(".venv: ")
    assert ended.stderr.count("\n") == 1
    assert not (folder / ".venv" / ".installed").exists()


@pytest.mark.parametrize("kind", ["another's", "a file", "a link to nowhere"])
def test_an_environment_that_is_not_ours_is_left_as_it_is(folder, kind):
    if kind == "another's":
        (folder / ".venv" / "bin").mkdir(parents=True)
        (folder / ".venv" / "notes.txt").write_text("mine")
    elif kind == "a file":
        (folder / ".venv").touch()
    else:
        (folder / ".venv").symlink_to(folder / "nowhere")
    before = sorted(folder.rglob("*"))
    with pytest.raises(SystemExit, match=r"^\.venv: not made by this Makefile"):
        install.clear_environment()
    assert sorted(folder.rglob("*")) == before


def test_ours_is_emptied_also_behind_a_link_and_what_was_added_by_hand_is_named(folder, capsys):
    site = folder / "disk" / "lib" / "python3.11" / "site-packages"
    for name in ("numpy-2.0", "Some_Tool-1.0"):
        (site / f"{name}.dist-info").mkdir(parents=True)
        about = site / f"{name}.dist-info" / "METADATA"
        about.write_text(f"Name: {name.partition('-')[0]}\nVersion: 1\n")
    (folder / "disk" / install.MARK).write_text("numpy==2.0 \\\n    --hash=sha256:00\n")
    (folder / ".venv").symlink_to("disk")
    install.clear_environment()
    assert capsys.readouterr().out == "Packages that were added to .venv by hand go: some-tool\n"
    assert (folder / ".venv").is_symlink()
    assert [*(folder / "disk").iterdir()] == []
    install.clear_environment()


@pytest.mark.parametrize("major", [3, 4])
def test_another_python_than_that_of_the_environment_is_noticed(folder, major):
    (folder / ".venv").mkdir()
    about = folder / ".venv" / "pyvenv.cfg"
    about.write_text(f"home = /usr/bin\nversion = {major}.{sys.version_info.minor}.1\n")
    assert install.has_this_python() == (major == sys.version_info.major)


def test_a_second_make_waits_and_finds_what_the_first_has_installed(folder):
    (folder / ".make").mkdir()
    (folder / ".venv").mkdir()
    for name in ("pyproject.toml", "requirements.lock", ".venv/.installed"):
        (folder / name).touch()
    number = ".".join(map(str, sys.version_info[:3]))
    (folder / ".venv" / "pyvenv.cfg").write_text(f"version = {number}\n")
    os.utime(folder / "pyproject.toml", (2**32, 2**32))
    with (folder / ".make" / "install.lock").open("wb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        second = subprocess.Popen(
            [sys.executable, "-u", "-m", "workbook.install", ".venv/.installed"],
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            text=True,
        )
        assert "waiting" in second.stdout.readline()
        os.utime(folder / ".venv" / ".installed", (2**32, 2**32))
    assert second.wait(60) == 0


def test_every_group_of_the_project_is_in_the_lock():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    lock = (ROOT / "requirements.lock").read_text("utf-8")
    of_uv, others = install.split_lock(lock)
    assert of_uv.startswith("uv==")
    assert sorted((of_uv + others).splitlines()) == sorted(lock.splitlines())
    for group in project["dependency-groups"]:
        for each in install.in_group(project["dependency-groups"], group):
            name = install.re.match("[A-Za-z0-9-]+", each)[0].lower()
            assert f"\n{name}==" in f"\n{lock}", each


def test_values_are_written_as_toml_has_them():
    values = {"a": [1, True, 'say "x"'], "b": [{"url": "u", "default": False}]}
    text = "".join(f"{name} = {install._as_toml(value)}\n" for name, value in values.items())
    assert tomllib.loads(text) == values
