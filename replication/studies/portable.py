"""Tests and verdicts under other processors' settings: `make portable`.

Libraries choose machine code by the processor: OpenBLAS its kernel, numba its target, NumPy its SIMD loops. Here all
three are set as on other x86-64 processors, and every process checks that they are in effect.
"""

import ctypes
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import scipy
from llvmlite.binding import get_host_cpu_features

from replication.workbook import ROOT, judging

KERNELS = ("SkylakeX", "Haswell", "Zen", "Prescott")
# Instructions that a kernel needs; a processor without them cannot run it.
NEEDS = {"SkylakeX": "avx512bw", "Haswell": "avx2", "Zen": "avx2"}
# What OpenBLAS calls a kernel where another name stands for it: builds without Zen's own kernel use Haswell's for it,
# and the first name of the kernel for processors without AVX is Katmai.
ALIASES = {"Zen": "Haswell", "Prescott": "Katmai"}
# The first three are about files and processes, and their notebooks run in pinned kernels anyway; the last runs every
# notebook dozens of times, and those that are cheap are run here to their verdicts.
LEFT_OUT = ("tests/workbook", "tests/report", "tests/sensor/test_many.py", "tests/test_try_changing.py")
SETTING_VARIABLE = "REPLICATION_SETTING"


class NotInEffect(RuntimeError):
    """A setting is not in effect in this process."""


class OtherMachine(RuntimeError):
    """The machine is no x86-64."""


@dataclass(frozen=True)
class Setting:
    """How a processor makes the libraries behave.

    Attributes
    ----------
    kernel : str
        OpenBLAS's, one of `KERNELS`.
    generic : bool
        numba compiles for a generic x86-64 processor, else for this one.
    simd : bool
        NumPy may use this processor's SIMD instructions, else only those that every x86-64 has.
    """

    kernel: str
    generic: bool
    simd: bool

    @property
    def name(self) -> str:
        """Name on the command line, such as `prescott-generic-plain`."""
        return "-".join([self.kernel.lower(), "generic" if self.generic else "here", "simd" if self.simd else "plain"])

    def environment(self) -> dict[str, str]:
        """Environment variables of a process under the setting; the others are this process's."""
        others = ("NUMBA_CPU_", "NPY_DISABLE_CPU_", "NPY_ENABLE_CPU_", "PYTEST_")
        variables = {name: value for name, value in os.environ.items() if not name.startswith(others)}
        variables |= {"OPENBLAS_CORETYPE": self.kernel, "OPENBLAS_NUM_THREADS": "1", SETTING_VARIABLE: self.name}
        variables |= {"MPLBACKEND": "Agg", "PYTHONHASHSEED": "0", "PYTHONUNBUFFERED": "1"}
        variables["PYTHONPATH"] = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
        if self.generic:
            variables["NUMBA_CPU_NAME"] = "generic"
        if not self.simd:
            variables["NPY_DISABLE_CPU_FEATURES"] = " ".join(_numpy_simd("found") + _numpy_simd("not found"))
        return variables


# Each value of the three, numba and NumPy in all pairs, and the kernel without AVX with the newest and the plainest.
# The last is the most different from a new processor's own.
SETTINGS = (
    Setting("SkylakeX", generic=False, simd=True),
    Setting("Haswell", generic=True, simd=True),
    Setting("Zen", generic=False, simd=False),
    Setting("Prescott", generic=False, simd=True),
    Setting("Prescott", generic=True, simd=False),
)


# ---------------------------------------------------------------------------------------------------------------
# In the process that a setting is for


def _numpy_simd(which: str) -> list[str]:
    """Groups of SIMD instructions beyond every x86-64's that NumPy has loops for: "found" in use, or "not found"."""
    return list(np.show_config(mode="dicts")["SIMD Extensions"].get(which, []))


def _openblas_kernels() -> set[str]:
    """Kernels of the OpenBLAS libraries that NumPy and SciPy bring."""
    kernels = set()
    for package in (np, scipy):
        folder = Path(package.__file__).parents[1] / f"{package.__name__}.libs"
        for path in folder.glob("*openblas*"):
            library = ctypes.CDLL(str(path))
            for name in ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename"):
                if hasattr(library, name):
                    corename = getattr(library, name)
                    corename.restype = ctypes.c_char_p
                    kernels.add(corename().decode())
    return kernels


def _numba_target() -> str:
    """Name of the processor that numba compiles for."""
    from numba.core.registry import cpu_target

    return cpu_target.target_context.codegen().magic_tuple()[1]


def check_setting(setting: Setting) -> str:
    """Check that a setting is in effect in this process.

    Returns
    -------
    str
        What is in effect, for people.

    Raises
    ------
    NotInEffect
        It is not.
    """
    kernels, target, simd = _openblas_kernels(), _numba_target(), _numpy_simd("found")
    found = f"OpenBLAS {', '.join(sorted(kernels)) or '-'}; numba {target}; NumPy {' '.join(simd) or 'without SIMD'}"
    named = bool(kernels) and kernels <= {setting.kernel, ALIASES.get(setting.kernel)}
    if not named or (target == "generic") != setting.generic or bool(simd) != setting.simd:
        raise NotInEffect(f"{setting.name} is not in effect: {found}")
    return found


def setting_named(name: str) -> Setting:
    """The setting of a name.

    Raises
    ------
    ValueError
        There is none; the message names them.
    """
    for setting in SETTINGS:
        if setting.name == name:
            return setting
    raise ValueError(f"no such setting: {name}; there are {', '.join(setting.name for setting in SETTINGS)}")


def pytest_report_header() -> str:
    """Say in the tests' header what is in effect; pytest calls it in the process that leads."""
    return f"in effect: {check_setting(setting_named(os.environ[SETTING_VARIABLE]))}"


def pytest_configure() -> None:
    """Check the setting in every process that runs tests; pytest calls it."""
    check_setting(setting_named(os.environ[SETTING_VARIABLE]))


def cheap_notebooks() -> list[Path]:
    """The notebooks whose quick run is their whole run, as they declare by `quick: {}`."""
    sources = sorted((ROOT / "notebooks").glob("[0-9]*.py"))
    return [source for source in sources if re.search(r"^#\s+quick: \{\}$", source.read_text(encoding="utf-8"), re.M)]


def run_notebooks_here(folder: Path, sources: Sequence[Path]) -> None:
    """Run notebooks in this process after checking its setting; what they export, and `failed.json`, go to a folder."""
    from matplotlib import pyplot

    check_setting(setting_named(os.environ[SETTING_VARIABLE]))
    failed = []
    for source in sources:
        os.environ |= {"REPLICATION_OUT": str(folder), "REPLICATION_NOTEBOOK": source.stem, "REPLICATION_QUICK": "0"}
        variables = {"__name__": "__main__", "display": lambda *shown, **options: None}
        try:
            exec(compile(source.read_text(encoding="utf-8"), str(source), "exec"), variables)
        except Exception as error:  # whatever it is, the others still run
            failed.append(f"{source.stem}: {type(error).__name__}: {error}")
        pyplot.close("all")
    (folder / "failed.json").write_text(json.dumps(failed), encoding="utf-8")


# ---------------------------------------------------------------------------------------------------------------
# In the process that goes through the settings


@dataclass(frozen=True)
class Outcome:
    """What a setting came to.

    Attributes
    ----------
    setting : str
        Its name.
    effect : str
        What was in effect, as the test process found it.
    tests : str
        pytest's last line.
    failures : tuple of str
        What failed.
    verdicts : dict of (id, source) to str
        Of the cheap notebooks' cells and claims; None if they were not run.
    seconds : float
        Wall time.
    """

    setting: str
    effect: str
    tests: str
    failures: tuple[str, ...]
    verdicts: Mapping[tuple[str, str], str] | None
    seconds: float


def run_tests(setting: Setting, paths: Sequence[str] = ()) -> tuple[str, str, list[str]]:
    """Run the tests that compute, in processes under a setting.

    Parameters
    ----------
    setting : Setting
        The setting.
    paths : sequence of str, optional
        Tests to run; by default all but `LEFT_OUT`.

    Returns
    -------
    str, str, list of str
        What was in effect, pytest's last line, and a line for each failure.
    """
    chosen = list(paths) or [f"--ignore={path}" for path in LEFT_OUT]
    options = ["-v", "--numprocesses", "2", "--dist", "worksteal", "-p", "replication.studies.portable"]
    command = [sys.executable, "-m", "pytest", *options, *chosen]
    done = subprocess.run(command, cwd=ROOT, env=setting.environment(), capture_output=True, text=True, check=False)
    lines = done.stdout.splitlines()
    effect = [line.removeprefix("in effect: ") for line in lines if line.startswith("in effect: ")]
    failures = [line for line in lines if line.startswith(("FAILED ", "ERROR "))]
    if done.returncode and not failures:
        said = (done.stderr.strip() or done.stdout.strip()).splitlines()[-1:]
        failures = [f"the tests ended early, with exit status {done.returncode}: {' '.join(said)}"]
    if not done.returncode and not effect:
        failures = ["no test process has checked the setting"]
    return "".join(effect), lines[-1].strip("= ") if lines else "", failures


def run_notebooks(
    setting: Setting, folder: Path, sources: Sequence[Path] | None = None
) -> tuple[dict[tuple[str, str], str], list[str]]:
    """Run notebooks in a process under a setting; return the verdicts on their cells and claims, and what failed."""
    sources = cheap_notebooks() if sources is None else sources
    call = f"run_notebooks_here(Path({str(folder)!r}), [Path(name) for name in {[str(path) for path in sources]!r}])"
    command = [sys.executable, "-c", f"from replication.studies.portable import *\n{call}"]
    done = subprocess.run(command, cwd=ROOT, env=setting.environment(), capture_output=True, text=True, check=False)
    if done.returncode:
        return {}, [f"notebooks: {(done.stderr.strip().splitlines() or ['the process ended'])[-1]}"]
    return verdicts_in(folder / "results"), json.loads((folder / "failed.json").read_text(encoding="utf-8"))


def verdicts_in(results: Path) -> dict[tuple[str, str], str]:
    """Verdicts on the cells and claims that notebooks left in a results folder, by id and source."""
    exported = judging.outcomes(results)
    rows = [row | {"notebook": name} for name, outcome in exported.items() for row in outcome["cells"]]
    claims = judging.decided_claims(results)
    found = {(name, "claim"): verdict for name, verdict in zip(claims["id"], claims["verdict"], strict=True)}
    if rows:
        cells = judging.judge(pd.DataFrame(rows))
        found |= dict(zip(zip(cells["id"], cells["source"], strict=True), cells["verdict"], strict=True))
    return found


def differing(outcomes: Sequence[Outcome]) -> list[str]:
    """A line for each cell and claim whose verdict is not the same under all settings."""
    judged = [outcome for outcome in outcomes if outcome.verdicts is not None]
    keys = sorted({key for outcome in judged for key in outcome.verdicts})
    lines = []
    for key in keys:
        found = {outcome.setting: outcome.verdicts.get(key, "none") for outcome in judged}
        if len(set(found.values())) > 1:
            said = ", ".join(f"{verdict} with {name}" for name, verdict in found.items())
            lines.append(f"{key[0]} ({key[1]}): {said}")
    return lines


def kernels_here() -> list[str]:
    """OpenBLAS kernels that this processor can run, whatever the libraries were told of it."""
    features = get_host_cpu_features()
    return [kernel for kernel in KERNELS if kernel not in NEEDS or features.get(NEEDS[kernel])]


def settings_here() -> tuple[list[Setting], list[str]]:
    """The settings that this processor can run, and a line for each that it cannot.

    Raises
    ------
    OtherMachine
        It is no x86-64.
    """
    if platform.machine() not in ("x86_64", "AMD64"):
        raise OtherMachine(f"these settings are of x86-64 processors; this machine is {platform.machine()}")
    able = [setting for setting in SETTINGS if setting.kernel in kernels_here()]
    unable = [setting for setting in SETTINGS if setting not in able]
    return able, [f"{setting.name} not tried: this processor has no {NEEDS[setting.kernel]}" for setting in unable]


def portable(
    only_tests_of: str | None = None, tell: Callable[[str], None] = print
) -> tuple[pd.DataFrame, list[str], list[str]]:
    """Run the tests that compute, and the cheap notebooks to their verdicts, under each setting.

    Parameters
    ----------
    only_tests_of : str, optional
        Name of the only setting, whose tests alone are run.
    tell : callable
        Told one line for each setting as it ends.

    Returns
    -------
    DataFrame, list of str, list of str
        As of `table`; settings that this processor cannot run; tests that failed and verdicts that differ, a line each.

    Raises
    ------
    ValueError
        There is no such setting.
    OtherMachine
        This machine is no x86-64.
    """
    settings, unable = settings_here()
    if only_tests_of:
        settings, unable = [setting_named(only_tests_of)], []
    outcomes = []
    for setting in settings:
        outcomes.append(_try(setting, notebooks=not only_tests_of))
        tell(_line(outcomes[-1]))
    problems = [f"{outcome.setting}: {failure}" for outcome in outcomes for failure in outcome.failures]
    return table(outcomes), unable, problems + differing(outcomes)


def _try(setting: Setting, notebooks: bool) -> Outcome:
    begun = time.perf_counter()
    effect, tests, failures = run_tests(setting)
    verdicts = None
    if notebooks:
        with tempfile.TemporaryDirectory() as folder:
            verdicts, failed = run_notebooks(setting, Path(folder))
        failures += failed
    return Outcome(setting.name, effect, tests, tuple(failures), verdicts, time.perf_counter() - begun)


def _line(outcome: Outcome) -> str:
    judged = "" if outcome.verdicts is None else f"; {len(outcome.verdicts)} verdicts"
    return f"{outcome.setting} ({outcome.effect}): {outcome.tests}{judged}; {outcome.seconds:.0f} s"


def table(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """One row per setting: `setting, in_effect, passed, skipped, failures, verdicts, differing`.

    `verdicts` counts those of the cheap notebooks, `differing` those that are not the first setting's.
    """
    first = next((outcome.verdicts for outcome in outcomes if outcome.verdicts is not None), {})
    rows = []
    for outcome in outcomes:
        verdicts = {} if outcome.verdicts is None else outcome.verdicts
        keys = verdicts.keys() | first.keys() if outcome.verdicts is not None else ()
        off = sum(verdicts.get(key) != first.get(key) for key in keys)
        counts = {word: int(count) for count, word in re.findall(r"(\d+) (passed|skipped)", outcome.tests)}
        tests = [counts.get("passed", 0), counts.get("skipped", 0), len(outcome.failures)]
        rows.append([outcome.setting, outcome.effect, *tests, len(verdicts), off])
    columns = ["setting", "in_effect", "passed", "skipped", "failures", "verdicts", "differing"]
    return pd.DataFrame(rows, columns=columns)
