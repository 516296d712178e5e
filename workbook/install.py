"""The locked versions, into .venv: `python -m workbook.install STAMP` makes one of the stamps of the Makefile.

By the standard library alone, for nothing else is there yet. `.venv/.installed` is the environment that notebooks run
in; `.venv/.NAME` is a group of pyproject.toml besides. A stamp is set when what it promises can be imported from .venv,
in the locked version: a tool that ends well may have put it elsewhere.
"""

import contextlib
import fcntl
import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, distributions, version
from pathlib import Path
from typing import Any

from workbook.parent import make_lives

VENV = Path(".venv")
PYTHON = str(VENV / "bin" / "python")
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
# What the user's settings of pip and uv may say: where packages come from. The rest would change what is installed, or
# put it elsewhere.
PIP_SETTINGS = {"index-url", "extra-index-url", "no-index", "find-links", "trusted-host", "proxy"}
PIP_SETTINGS |= {"cert", "client-cert", "cache-dir", "timeout", "retries"}
UV_SETTINGS = {"index", "index-url", "default-index", "extra-index-url", "no-index", "find-links"}
UV_SETTINGS |= {"index-strategy", "keyring-provider", "allow-insecure-host", "insecure-host"}
UV_SETTINGS |= {"native-tls", "system-certs", "cache-dir", "http-timeout", "offline"}
CONSOLE = """#!/bin/sh
exec "$(dirname -- "$(readlink -f -- "$0")")/python" -m backlash "$@"
"""
# Prints what is missing, or there in another version, of what is asked for and of all that this needs.
CHECK = """
import importlib, json, sys
from importlib.metadata import PackageNotFoundError, distribution
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name as canonical
asked, lock = map(json.loads, sys.argv[1:])
pinned = [each for each in map(Requirement, lock) if not each.marker or each.marker.evaluate()]
locked = {canonical(each.name): str(each.specifier).removeprefix("==") for each in pinned}
todo, seen = [Requirement(each) for each in asked], set()
while todo:
    need = todo.pop()
    name = canonical(need.name)
    if (name, *need.extras) in seen:
        continue
    seen.add((name, *need.extras))
    try:
        there = distribution(name)
    except PackageNotFoundError:
        sys.exit(f"{name} is not there")
    if there.version != locked.get(name, there.version):
        sys.exit(f"{name} is there as {there.version}, not {locked[name]}")
    extras = [{"extra": each} for each in ("", *need.extras)]
    needs = map(Requirement, there.requires or [])
    todo += [each for each in needs if not each.marker or any(map(each.marker.evaluate, extras))]
files = [file for each in asked for file in distribution(Requirement(each).name).files or []]
packages = {file.parts[0] for file in files if len(file.parts) == 2 and file.name == "__init__.py"}
alone = {file.name.partition(".")[0] for file in files if len(file.parts) == 1 and file.suffix in (".py", ".so")}
for module in packages | alone:
    if module.isidentifier() and module[0] != "_" and "__" not in module:
        try:
            importlib.import_module(module)
        except Exception as error:
            sys.exit(f"{module} cannot be imported ({error!r})")
"""


def main(stamp: Path) -> None:
    """Make one stamp, unless another make has made it meanwhile."""
    made_from = [Path("pyproject.toml"), LOCK]
    with only_one():
        if stamp.name != ".installed":
            made_from.append(VENV / ".installed")
        is_base = stamp.name == ".installed"
        is_new = stamp.exists() and all(_time(stamp) >= _time(file) for file in made_from)
        if is_new and (has_this_python() or not is_base):
            return
        if is_base:
            make_environment()
        group = [] if is_base else ["--group", stamp.name[1:]]
        install(group or BASE)
        if lacks := find_lacking(group[1:] or ["workbook"], is_base=not group):
            sys.exit(
                f"{VENV}: {lacks}; pip and uv said that it is; is a setting of theirs in the way?"
            )
        stamp.touch()
        # Where the clock is behind, a stamp gets the time of what it was made from; else all would be installed again.
        newest = max([stamp, *made_from], key=_time)
        os.utime(stamp, ns=(newest.stat().st_mtime_ns,) * 2)


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
            while True:
                with contextlib.suppress(BlockingIOError):
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                make_lives() or sys.exit(1)
                time.sleep(0.5)
        yield


def make_environment() -> None:
    """Make .venv anew, with the sensor's command; whatever is started from it finds the packages of this folder.

    The path to them is relative, so that a copied or moved checkout finds its own.
    """
    clear_environment()
    uv, other = split_lock(LOCK.read_text("utf-8"))
    (VENV / "uv.lock").write_text(uv)
    (VENV / MARK).write_text(other)
    run([sys.executable, "-m", "venv", "--without-pip", str(VENV)], environment()) or sys.exit(2)
    (site,) = VENV.glob("lib/python*/site-packages")
    (site / "checkout.pth").write_text("../../../..\n")
    console = VENV / "bin" / "backlash"
    console.write_text(CONSOLE)
    console.chmod(0o755)
    print("The locked versions are being installed into .venv", flush=True)
    if not shutil.which("uv"):
        run_pip(VENV / "uv.lock")


def has_this_python() -> bool:
    """Whether .venv has the Python, to its second number, that this is."""
    about = VENV / "pyvenv.cfg"
    numbers = re.escape(".".join(map(str, sys.version_info[:2])))
    return about.exists() and bool(re.search(rf"(?m)^version = {numbers}\.", about.read_text()))


def clear_environment() -> None:
    """Empty .venv, or make it; end where it is another's. What was added to it by hand is named."""
    is_ours = VENV.is_dir() and ((VENV / MARK).exists() or not any(VENV.iterdir()))
    if not is_ours and (VENV.exists() or VENV.is_symlink()):
        sys.exit(f"{VENV}: not made by this Makefile, and left as it is; move it away")
    if added := find_added():
        print(f"Packages that were added to {VENV} by hand go: {', '.join(added)}")
    VENV.mkdir(exist_ok=True)  # a link, or a disk of its own, stays
    for each in VENV.iterdir():
        shutil.rmtree(each) if each.is_dir() and not each.is_symlink() else each.unlink()


def find_added() -> list[str]:
    """Find the packages in .venv that the lock which it was made from does not have."""
    lock = (VENV / MARK).read_text("utf-8") if (VENV / MARK).exists() else ""
    locked = {*re.findall(r"(?m)^([\w.-]+)==", lock), "pip", "setuptools", "uv"}
    sites = [str(site) for site in VENV.glob("lib/python*/site-packages")]
    there = {re.sub(r"[-_.]+", "-", each.name).lower() for each in distributions(path=sites)}
    return sorted(there - locked)


def split_lock(text: str) -> tuple[str, str]:
    """The lock's requirement of uv, and the others."""
    requirements = re.findall(r"^\S(?:.*\\\n)*.*\n", text, re.MULTILINE)
    of_uv = [each for each in requirements if each.startswith("uv==")]
    return "".join(of_uv), "".join(each for each in requirements if each not in of_uv)


def install(what: Sequence[str]) -> None:
    """Install by uv, which takes seconds and only what is asked for; where it can't be had, the whole lock by pip."""
    path = {"PATH": f"{os.environ.get('PATH', os.defpath)}{os.pathsep}{VENV / 'bin'}"}
    (VENV / "uv.toml").write_text(uv_settings())
    if uv := shutil.which("uv", path=path["PATH"]):
        command = [uv, "pip", "install", "--quiet", "--config-file", str(VENV / "uv.toml")]
        command += ["--python", PYTHON, "--require-hashes", "--constraint", str(LOCK), *what]
        if run(command, environment() | path):
            return
    run_pip(VENV / MARK) or sys.exit(2)


def run_pip(lock: Path) -> bool:
    """Whether pip installs what a lock has, whatever else the user's files say."""
    command = [*pip(), "install", "--quiet", "--no-user", "--require-hashes"]
    return run([*command, "--requirement", str(lock)], environment() | pip_settings())


@cache
def pip() -> list[str]:
    """The command pip for .venv: of the Python that makes it, or where that has none, in .venv, which takes seconds."""
    with contextlib.suppress(PackageNotFoundError, ValueError):
        if [*map(int, version("pip").split(".")[:2])] >= [22, 3]:  # which knows --python
            return [sys.executable, "-I", "-m", "pip", "--python", PYTHON]
    run([PYTHON, "-I", "-m", "ensurepip"], environment()) or sys.exit(2)
    return [PYTHON, "-I", "-m", "pip"]


def environment() -> dict[str, str]:
    """The user's variables, less those of Python and pip, and of uv that say anything but where packages come from."""
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("PIP_", "UV_", "PYTHON", "VIRTUAL_ENV", "CONDA_"))
        or (name.startswith("UV_") and _option(name, "UV_") in UV_SETTINGS)
    }


def _option(variable: str, prefix: str) -> str:
    return variable.removeprefix(prefix).lower().replace("_", "-")


def pip_settings() -> dict[str, str]:
    """The user's settings of pip that are kept, as variables, whichever file they stand in; files are read no more."""
    listed = subprocess.run([*pip(), "config", "list"], capture_output=True, text=True)
    if listed.returncode:
        sys.exit(f"pip's settings cannot be read: {' '.join(listed.stderr.splitlines()[-4:])}")
    settings = []
    for section in ("global", "install", ":env:"):  # the last one counts
        settings += re.findall(rf"^{section}\.([a-z-]+)='(.*)'$", listed.stdout, re.MULTILINE)
    kept = {
        f"PIP_{name.upper().replace('-', '_')}": value.replace("\\n", " ").strip()
        for name, value in settings
        if name in PIP_SETTINGS
    }
    return kept | {"PIP_CONFIG_FILE": os.devnull, "PIP_DISABLE_PIP_VERSION_CHECK": "1"}


def uv_settings() -> str:
    """The user's settings of uv that are kept, in TOML, of the file that uv would read first."""
    home = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
    named = Path(os.environ.get("UV_CONFIG_FILE", os.devnull))
    for file in (named, home / "uv" / "uv.toml", Path("/etc/uv/uv.toml")):
        if not file.is_file():
            continue
        try:
            settings = tomllib.loads(file.read_text("utf-8"))
        except ValueError as error:
            sys.exit(f"{file}: {error}")
        of_both = settings | settings.get("pip", {})
        kept = {name: value for name, value in of_both.items() if name in UV_SETTINGS}
        return "".join(f"{name} = {_as_toml(value)}\n" for name, value in kept.items())
    return ""


def _as_toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_as_toml(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_as_toml, value)) + "]"
    return json.dumps(value)


def run(command: list[str], variables: Mapping[str, str]) -> bool:
    """Whether a command ends well; it ends when make does."""
    with subprocess.Popen(command, env=dict(variables)) as process:
        while process.poll() is None:
            if not make_lives():
                process.kill()
                sys.exit(1)
            time.sleep(0.1)
    return process.returncode == 0


def find_lacking(groups: list[str], is_base: bool) -> str:
    """Say what of some groups of pyproject.toml cannot be imported from .venv in the locked version; "" if nothing."""
    project = tomllib.loads(Path("pyproject.toml").read_text("utf-8"))
    asked = [each for group in groups for each in in_group(project["dependency-groups"], group)]
    if is_base:
        asked += project["project"]["dependencies"]
        asked += [
            each
            for name in ("plot", "xlsx")
            for each in project["project"]["optional-dependencies"][name]
        ]
    locked = re.findall(r"^[^ #].*?(?= *\\?$)", LOCK.read_text("utf-8"), re.MULTILINE)
    command = [PYTHON, "-I", "-c", CHECK, json.dumps(asked), json.dumps(locked)]
    checked = subprocess.run(command, capture_output=True, text=True, env=environment())
    return checked.stderr.strip().rpartition("\n")[2] if checked.returncode else ""


def in_group(groups: Mapping[str, list], name: str) -> list[str]:
    """Requirements of a group, those of groups that it includes too."""
    listed: list[str] = []
    for each in groups[name]:
        listed += [each] if isinstance(each, str) else in_group(groups, each["include-group"])
    return listed


if __name__ == "__main__":
    main(Path(sys.argv[1]))
