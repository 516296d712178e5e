"""The locked versions, into .venv: `python -m workbook.install STAMP` makes one of the stamps of the Makefile.

By the standard library alone, for nothing else is there yet. `.venv/.installed` is the environment that notebooks run
in; `.venv/.NAME` is a group of pyproject.toml besides. A stamp is set when what it promises can be imported from .venv,
in the locked version: a tool that ends well may have put it elsewhere, as a user's settings may tell it.
"""

import contextlib
import fcntl
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import Distribution, distributions
from importlib.util import find_spec
from pathlib import Path

from workbook.parent import make_lives

VENV = Path(".venv")
PYTHON = str(VENV / "bin" / "python")
SITE = VENV / "lib" / "python{}.{}".format(*sys.version_info) / "site-packages"
LOCK = Path("requirements.lock")
MARK = "all.lock"  # in .venv, by which it is ours
BASE = (
    "--requirement",
    "pyproject.toml",
    "--extra",
    "plot",
    "--extra",
    "xlsx",
    "--group",
    "workbook",
)
# Of the variables PIP_... and UV_..., those that say where packages come from; the others change what is installed, or
# put it elsewhere.
SOURCES = {"INDEX", "INDEX_URL", "DEFAULT_INDEX", "EXTRA_INDEX_URL", "NO_INDEX", "FIND_LINKS"}
SOURCES |= {"INDEX_STRATEGY", "TRUSTED_HOST", "INSECURE_HOST", "ALLOW_INSECURE_HOST", "PROXY"}
SOURCES |= {"CERT", "CLIENT_CERT", "NATIVE_TLS", "SYSTEM_CERTS", "KEYRING_PROVIDER", "CACHE_DIR"}
SOURCES |= {"TIMEOUT", "DEFAULT_TIMEOUT", "HTTP_TIMEOUT", "RETRIES", "OFFLINE", "CONFIG_FILE"}
CONSOLE = """#!/bin/sh
exec "$(dirname -- "$(readlink -f -- "$0")")/python" -m backlash "$@"
"""
# Imports the modules of some packages.
CHECK = """
import importlib, sys
from importlib.metadata import packages_distributions
for module, packages in packages_distributions().items():
    if {*packages} & {*sys.argv} and module.isidentifier() and "__" not in module and module[0] != "_":
        try:
            importlib.import_module(module)
        except Exception as error:
            sys.exit(f"{module} cannot be imported ({error!r})")
"""


def main(stamp: Path) -> None:
    """Make one stamp, unless another make has made it meanwhile."""
    is_base = stamp.name == ".installed"
    made_from = [Path("pyproject.toml"), LOCK, *([] if is_base else [VENV / ".installed"])]
    with only_one():
        is_new = stamp.exists() and all(_time(stamp) >= _time(file) for file in made_from)
        if is_new and (SITE.is_dir() or not is_base):
            return
        if is_base:
            make_environment()
        install(BASE if is_base else ("--group", stamp.name[1:]))
        if lacks := find_lacking("workbook" if is_base else stamp.name[1:]):
            sys.exit(
                f"{VENV}: {lacks}; pip and uv said that it is; is a setting of theirs in the way?"
            )
        stamp.touch()
        # Where the clock is behind, a stamp gets the time of what it was made from; else all would be installed again.
        os.utime(stamp, ns=(max(map(_time, [stamp, *made_from])),) * 2)


def _time(file: Path) -> int:
    return file.stat().st_mtime_ns


@contextlib.contextmanager
def only_one() -> Iterator[None]:
    """Wait while another make installs."""
    Path(".make").mkdir(exist_ok=True)
    with Path(".make", "install.lock").open("wb") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("Another make installs into .venv: waiting for it")
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def make_environment() -> None:
    """Make .venv anew, with the sensor's command; whatever is started from it finds the packages of this folder.

    The path to them is relative, so that a copied or moved checkout finds its own.
    """
    clear_environment()
    uv, other = split_lock(LOCK.read_text("utf-8"))
    (VENV / "uv.lock").write_text(uv)
    (VENV / MARK).write_text(other)
    run([sys.executable, "-m", "venv", "--without-pip", str(VENV)])
    (SITE / "checkout.pth").write_text("../../../..\n")
    console = VENV / "bin" / "backlash"
    console.write_text(CONSOLE)
    console.chmod(0o755)
    print("The locked versions are being installed into .venv", flush=True)
    if not shutil.which("uv"):
        run_pip(VENV / "uv.lock")


def clear_environment() -> None:
    """Empty .venv, or make it; end where it is another's. What was added to it by hand is named."""
    is_ours = VENV.is_dir() and ((VENV / MARK).exists() or not any(VENV.iterdir()))
    if not is_ours and (VENV.exists() or VENV.is_symlink()):
        sys.exit(f"{VENV}: not made by this Makefile, and left as it is; move it away")
    locked = (VENV / MARK).read_text("utf-8") if (VENV / MARK).exists() else ""
    known = {*re.findall(r"(?m)^([\w.-]+)==", locked), "pip", "setuptools", "uv"}
    if added := sorted(find_installed().keys() - known):
        print(f"Packages that were added to {VENV} by hand go: {', '.join(added)}")
    VENV.mkdir(exist_ok=True)  # a link, or a disk of its own, stays
    for each in VENV.iterdir():
        shutil.rmtree(each) if each.is_dir() and not each.is_symlink() else each.unlink()


def find_installed() -> dict[str, Distribution]:
    """Find the packages in .venv, by name."""
    sites = [str(site) for site in VENV.glob("lib/python*/site-packages")]
    return {re.sub(r"[-_.]+", "-", each.name).lower(): each for each in distributions(path=sites)}


def split_lock(text: str) -> tuple[str, str]:
    """The lock's requirement of uv, and the others."""
    requirements = re.findall(r"^\S(?:.*\\\n)*.*\n", text, re.MULTILINE)
    of_uv = [each for each in requirements if each.startswith("uv==")]
    return "".join(of_uv), "".join(each for each in requirements if each not in of_uv)


def install(what: Sequence[str]) -> None:
    """Install by uv, which takes seconds and only what is asked for; where it can't be had, the whole lock by pip."""
    path = f"{os.environ.get('PATH', os.defpath)}{os.pathsep}{VENV / 'bin'}"
    uv = shutil.which("uv", path=path)
    how = ["--quiet", "--python", PYTHON, "--require-hashes", "--constraint", str(LOCK)]
    is_done = uv and run([uv, "pip", "install", *how, *what])
    if not is_done and not run_pip(VENV / MARK):
        sys.exit(2)


def run_pip(lock: Path) -> bool:
    """Whether pip installs what a lock has."""
    how = ["--quiet", "--no-user", "--disable-pip-version-check", "--require-hashes"]
    return run([*pip(), "install", *how, "--requirement", str(lock)])


@cache
def pip() -> list[str]:
    """The command pip for .venv: of the Python that makes it, or where that has none, in .venv, which takes seconds."""
    if find_spec("pip"):  # 22.3 or newer, as with each Python from 3.11 on: it knows --python
        return [sys.executable, "-I", "-m", "pip", "--python", PYTHON]
    run([PYTHON, "-I", "-m", "ensurepip"])
    return [PYTHON, "-I", "-m", "pip"]


def environment() -> dict[str, str]:
    """The user's variables, less those of Python, and of pip and uv that say anything but where packages come from."""
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("PIP_", "UV_", "PYTHON", "VIRTUAL_ENV", "CONDA_"))
        or (name.startswith(("PIP_", "UV_")) and name.partition("_")[2] in SOURCES)
    }


def run(command: list[str]) -> bool:
    """Whether a command ends well; it ends when make does."""
    with subprocess.Popen(command, env=environment()) as process:
        while process.poll() is None:
            if not make_lives():
                process.kill()
                sys.exit(1)
            time.sleep(0.1)
    return process.returncode == 0


def find_lacking(group: str) -> str:
    """Say what of a group of pyproject.toml is not in .venv in the locked version, or can't be imported; "" if nothing.

    Of a package that not every machine needs, nothing is said.
    """
    groups = tomllib.loads(Path("pyproject.toml").read_text("utf-8"))["dependency-groups"]
    asked = [each for each in in_group(groups, group) if ";" not in each]
    names = [re.split(r"[^\w.-]", each)[0].lower() for each in asked]
    installed, lock = find_installed(), LOCK.read_text("utf-8")
    for name in names:
        there = installed[name].version if name in installed else ""
        if not re.search(rf"(?m)^{re.escape(f'{name}=={there}')}(?= |$)", lock):
            return f"{name} is not there in the locked version"
    command = [PYTHON, "-I", "-c", CHECK, *(installed[name].name for name in names)]
    checked = subprocess.run(command, capture_output=True, text=True)
    return checked.stderr.strip().rpartition("\n")[2] if checked.returncode else ""


def in_group(groups: Mapping[str, list], name: str) -> list[str]:
    """Requirements of a group, those of groups that it includes too."""
    listed: list[str] = []
    for each in groups[name]:
        listed += [each] if isinstance(each, str) else in_group(groups, each["include-group"])
    return listed


if __name__ == "__main__":
    main(Path(sys.argv[1]))
