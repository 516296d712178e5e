"""The locked versions, into .venv: `python -m workbook.install STAMP` makes one of the stamps of the Makefile.

By the standard library alone, for nothing else is there yet. `.venv/.installed` is the environment that notebooks run
in; `.venv/.NAME` is a group of pyproject.toml besides. A stamp is set when what it promises is in .venv, in the locked
version: a tool that ends well may have put it elsewhere, as a user's settings may tell it.
"""

import fcntl
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from importlib.metadata import distributions
from pathlib import Path

VENV = Path(".venv")
PYTHON = str(VENV / "bin" / "python")
SITE = VENV / "lib" / "python{}.{}".format(*sys.version_info) / "site-packages"
LOCK = Path("requirements.lock")
MARK = VENV / "all.lock"  # the lock but for uv, by which .venv is ours
INSTALLERS = re.compile("(pip|setuptools|uv)==")
OF_UV = re.compile(r"^uv==(?:.*\\\n)*.*\n", re.MULTILINE)
ELSEWHERE = ("PIP_TARGET", "PIP_PREFIX", "PIP_ROOT", "PIP_PYTHON")
BASE = ("--requirement", "pyproject.toml", "--extra", "plot", "--extra", "xlsx")
CONSOLE = """#!/bin/sh
exec "$(dirname -- "$(readlink -f -- "$0")")/python" -m backlash "$@"
"""


def main(stamp: Path) -> None:
    """Make one stamp, unless another make has made it meanwhile."""
    is_base = stamp.name == ".installed"
    group = "workbook" if is_base else stamp.name[1:]
    made_from = [Path("pyproject.toml"), LOCK, *([] if is_base else [VENV / ".installed"])]
    Path(".make").mkdir(exist_ok=True)
    with Path(".make", "install.lock").open("wb") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("Another make installs into .venv: waiting for it", flush=True)
            fcntl.flock(lock, fcntl.LOCK_EX)
        newest = max(file.stat().st_mtime_ns for file in made_from)
        if SITE.is_dir() and stamp.exists() and stamp.stat().st_mtime_ns >= newest:
            return
        if is_base:
            make_environment()
        install(group)
        if lacking := find_lacking(group):
            sys.exit(
                f"{VENV}: {lacking} is not there in the locked version; pip and uv said that it is; "
                "is a setting of theirs in the way?"
            )
        stamp.touch()
        # Where the clock is behind, a stamp gets the time of what it was made from; else all would be installed again.
        ended = max(newest, time.time_ns())
        os.utime(stamp, ns=(ended, ended))


def make_environment() -> None:
    """Make .venv anew, with the sensor's command; whatever is started from it finds the packages of this folder.

    The path to them is relative, so that a copied or moved checkout finds its own.
    """
    clear_environment()
    lock = LOCK.read_text("utf-8")
    MARK.write_text(OF_UV.sub("", lock))
    if not run([sys.executable, "-m", "venv", str(VENV)]):
        sys.exit(2)
    (SITE / "checkout.pth").write_text("../../../..\n")
    console = VENV / "bin" / "backlash"
    console.write_text(CONSOLE)
    console.chmod(0o755)
    print("The locked versions are being installed into .venv", flush=True)
    if not shutil.which("uv"):
        of_uv = VENV / "uv.lock"
        of_uv.write_text("".join(OF_UV.findall(lock)))
        run_pip(of_uv)


def clear_environment() -> None:
    """Empty .venv, or make it; end where it is another's. What was added to it by hand is named."""
    is_ours = VENV.is_dir() and (MARK.exists() or not any(VENV.iterdir()))
    if os.path.lexists(VENV) and not is_ours:
        sys.exit(f"{VENV}: not made by this Makefile, and left as it is; move it away")
    VENV.mkdir(exist_ok=True)  # a link, or a disk of its own, stays
    known = find_locked(MARK) if MARK.exists() else set()
    added = {each for each in find_installed() - known if not INSTALLERS.match(each)}
    if added:
        print(f"Packages that were added to {VENV} by hand go: {', '.join(sorted(added))}")
    for each in VENV.iterdir():
        shutil.rmtree(each) if each.is_dir() and not each.is_symlink() else each.unlink()


def find_locked(lock: Path) -> set[str]:
    """Find the packages of a lock, as name==version."""
    return {*re.findall(r"^\S+==\S+", lock.read_text("utf-8"), re.MULTILINE)}


def find_installed() -> set[str]:
    """Find the packages in .venv, as the lock writes them."""
    sites = [str(site) for site in VENV.glob("lib/python*/site-packages")]
    there = {re.sub(r"[-_.]+", "-", each.name).lower(): each for each in distributions(path=sites)}
    return {f"{name}=={each.version}" for name, each in there.items()}


def install(group: str) -> None:
    """Install by uv, which takes seconds and only what is asked for; where it can't be had, the whole lock by pip."""
    uv = shutil.which("uv", path=f"{os.environ.get('PATH', os.defpath)}:{VENV / 'bin'}")
    how = ["--quiet", "--python", PYTHON, "--require-hashes", "--constraint", str(LOCK)]
    is_done = uv and run([uv, "pip", "install", *how, *BASE, "--group", group])
    if not is_done and not run_pip(MARK):
        sys.exit(2)


def run_pip(lock: Path) -> bool:
    """Whether pip installs what a lock has."""
    how = ["--quiet", "--no-user", "--disable-pip-version-check", "--require-hashes"]
    return run([PYTHON, "-I", "-m", "pip", "install", *how, "--requirement", str(lock)])


def run(command: list[str]) -> bool:
    """Whether a command ends well; no variable of the user's has it put anything elsewhere."""
    variables = {name: value for name, value in os.environ.items() if name not in ELSEWHERE}
    return subprocess.call(command, env=variables) == 0


def find_lacking(group: str) -> str:
    """Find what a group of pyproject.toml names for every machine, and is not in .venv in the locked version."""
    asked = tomllib.loads(Path("pyproject.toml").read_text("utf-8"))["dependency-groups"][group]
    there = {each.partition("==")[0] for each in find_installed() & find_locked(LOCK)}
    everywhere = [each for each in asked if isinstance(each, str) and ";" not in each]
    names = [re.split(r"[^\w-]", each)[0] for each in everywhere]
    return ", ".join(name for name in names if name not in there)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
