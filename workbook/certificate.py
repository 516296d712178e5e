"""What a reviewer sends back: what ran here, on what, and whether its results are the committed ones."""

import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any

from llvmlite import binding

from replication.files import KEPT_SHA256, DataUnavailable, UserError
from workbook import judging
from workbook.project import (
    RESULTS,
    ROOT,
    find_hook,
    notebook_sources,
    pin_environment,
    read_settings,
)
from workbook.report import list_data, provenance
from workbook.stamps import REPORT, find_why_due, read_stamp, refuse_faults, sha256, sha256_of


def certify(full: bool = False) -> dict[str, Any]:
    """Gather what a rerun says.

    Parameters
    ----------
    full : bool
        Whether a row of each kept table is made again.

    Returns
    -------
    dict
        `commit` and what is `changed` since; date, machine, versions; of each notebook and the `report` why it does not
        count as made here ("" if it does), its seconds, and what it `lacks`; of each committed result, figure and
        notebook and of each file of public data two SHA-256, as measured and as committed or registered, whether
        they are the `same`, and whether the file was made here; of each kept table what a row made again is; of each
        printed number how it agrees, and by which notebook; or why none is judged.

    Raises
    ------
    UserError
        No notebook was run here, or this is no clone, which has nothing committed to compare with.
    """
    names = [*notebook_sources(), REPORT]
    runs = {name: read_stamp(ROOT, name) | {"why": find_why_due(ROOT, name)} for name in names}
    if not any(run["made"] for run in runs.values()):
        raise UserError("no notebook was run here: there is nothing to certify; make all runs them")
    made_here = {file for run in runs.values() if not run["why"] for file in run["made"]}
    committed = {*_git("ls-files", "-z", "results", "figures", "notebooks", "README.md")}
    results = {
        name: _compare(sha256(ROOT / name), sha256_of(_show(name)))
        | {"made_here": name in made_here}
        for name in sorted(made_here | {each for each in committed if _is_result(each)})
    }
    kept = [name for name in _list_kept() if name in results]
    unjudged, numbers = "", {}
    try:
        refuse_faults()
        verdicts = judging.verdicts(RESULTS)
        graded = verdicts.assign(grade=judging.grade(verdicts))
        numbers = graded[["grade", "notebook"]].to_dict("index")
    except UserError as error:
        unjudged = str(error)
    return {
        "commit": _git("rev-parse", "HEAD", end="\n")[0],
        "changed": _list_changes(),
        "date": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        "machine": f"{platform.platform()}, {binding.get_host_cpu_name()}, {os.cpu_count()} cores",
        "versions": provenance()["versions"] | {"python": platform.python_version()},
        "runs": runs,
        "data": _compare_data(),
        "results": results,
        "kept": {name: make_row_again(name) if full else "" for name in kept},
        "numbers": numbers,
        "unjudged": unjudged,
    }


def _is_result(name: str) -> bool:
    """Whether a committed file is one that is made: not a source, nor a page that a person writes."""
    if name.endswith(KEPT_SHA256):
        return False
    return name == "README.md" or not name.startswith("notebooks/") or name.endswith(".ipynb")


def _list_kept() -> list[str]:
    file = RESULTS / KEPT_SHA256
    kept = json.loads(file.read_text("utf-8")) if file.exists() else ()
    return [f"results/{name}" for name in kept]


def _compare(measured: str, expected: str) -> dict[str, Any]:
    return {"measured": measured, "expected": expected, "same": measured == expected}


def _compare_data() -> dict[str, dict[str, Any]]:
    """Hashes of the public data; in place of those that cannot be had, why."""
    registered, fetch = list_data(), find_hook("fetch")
    measured: dict[str, str] = {}
    for name in registered:
        try:
            measured[name] = sha256(fetch(name))
        except DataUnavailable as error:
            measured |= dict.fromkeys(registered, str(error))
            break
        except UserError as error:
            measured[name] = str(error)
    return {name: _compare(measured[name], registered[name]) for name in registered}


def make_row_again(table: str) -> str:
    """Make a row of a kept table again, by the settings' module: "same", "another", or why it is not made."""
    command = [sys.executable, "-m", read_settings(ROOT)["kept"], os.path.basename(table)[:-4]]
    variables = os.environ | pin_environment()
    ended = subprocess.run(command, cwd=ROOT, env=variables, capture_output=True, text=True)
    if ended.returncode:
        return f"not made again: {ended.stderr.strip().rpartition(chr(10))[2]}"
    kept = (ROOT / table).read_text("utf-8").splitlines()
    return "same" if {*ended.stdout.splitlines()} <= {*kept} else "another"


# -------------------------------------------------------------------------------------------------------- what git has


def _run_git(*arguments: str) -> subprocess.CompletedProcess[bytes]:
    try:
        return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True)
    except OSError as error:
        raise UserError(f"git is needed, to compare with what is committed ({error})") from error


def _git(*arguments: str, end: str = "\0") -> list[str]:
    """What git lists of this folder, which may lie in another one's clone."""
    ended = _run_git(*arguments)
    if ended.returncode or (
        not ended.stdout and arguments[0] == "ls-files" and "-o" not in arguments
    ):
        why = (ended.stderr.decode().splitlines() or ["git has nothing of it"])[0]
        raise UserError(f"{ROOT}: no clone with a commit: {why}")
    return [each for each in ended.stdout.decode().split(end) if each]


def _show(name: str) -> bytes:
    """A file as it is committed; nothing where it is not."""
    return _run_git("show", f"HEAD:./{name}").stdout


def _list_changes() -> list[str]:
    """List what is not as committed, and what is there besides and not ignored."""
    changed = _git("diff", "-z", "--name-only", "--relative", "HEAD")
    return sorted({*changed, *_git("ls-files", "-z", "-o", "--exclude-standard")})


# ------------------------------------------------------------------------------------------------------------ in words


def find_differences(about: dict[str, Any]) -> list[str]:
    """Say in a line each what a rerun did not make as it is committed, and what it did not run."""
    lines = [
        f"{name}: {run['why']}"
        for name, run in about["runs"].items()
        if run["why"] and not run["lacks"]
    ]
    lines += [
        f"{name}: not as committed" for name, each in about["results"].items() if not each["same"]
    ]
    lines += [f"{name}: changed since" for name in about["changed"] if name not in about["results"]]
    lines += [
        f"{name}: a row made again is another"
        for name, row in about["kept"].items()
        if row == "another"
    ]
    if about["unjudged"]:
        lines.append(f"no number is judged: {about['unjudged']}")
    files = about["data"].values()
    reasons = [each["measured"] for each in files if not each["same"]]
    return lines + [f"public data: {reason}" for reason in dict.fromkeys(reasons)]


def sum_up_seconds(runs: Iterable[dict[str, Any]]) -> str:
    """Write how long runs took: their sum, and the time in which one of them or more ran."""
    wall, until = 0.0, 0.0
    ran = sorted((run["ended"] - run["seconds"], run["ended"]) for run in runs)
    for start, end in ran:
        wall += max(0.0, end - max(start, until))
        until = max(until, end)
    return f"{sum(end - start for start, end in ran):.0f} s in sum, {wall:.0f} s of wall time"


def count_grades(about: dict[str, Any], is_here: bool) -> str:
    """Count printed numbers by how they agree, of the notebooks that count as run here, or of the others."""
    here = {
        "",
        *(name for name, run in about["runs"].items() if not run["why"]),
    }  # "": needs no run
    grades = [
        each["grade"] for each in about["numbers"].values() if (each["notebook"] in here) == is_here
    ]
    return (
        ", ".join(f"{grades.count(each)} {each}" for each in judging.GRADES) if grades else "none"
    )


def write_certificate(about: dict[str, Any]) -> str:
    """A page in Markdown that says what `certify` found."""
    results, kept, runs = about["results"], about["kept"], about["runs"]
    here = [name for name in notebook_names(about) if not runs[name]["why"]]
    made = [each["same"] for each in results.values() if each["made_here"]]
    unchanged = [name for name in kept if results[name]["same"]]
    names = ", ".join(os.path.basename(name) for name in unchanged) or "none"
    others = len(results) - len(made) - len(kept)
    files = [each["same"] for each in about["data"].values()]
    versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items())
    lines = [
        "# Certificate of a rerun",
        "",
        "| | |",
        "|-|-|",
        f"| commit | {about['commit']} |",
        f"| changed since | {', '.join(about['changed']) or 'nothing'} |",
        f"| date | {about['date']} |",
        f"| machine | {about['machine']} |",
        f"| versions | {versions} |",
        f"| notebooks run here with this code | {len(here)} of {len(notebook_names(about))}, "
        f"{sum_up_seconds(runs[name] for name in here)} |",
        f"| made here and the same | {sum(made)} of {len(made)} files that were made here |",
        f"| kept, unchanged, not made here | {names}; of what is made, {others} files were not |",
        f"| sources | public data as registered: {sum(files)} of {len(files)} |",
        f"| printed numbers, by notebooks run here | {count_grades(about, True)} |",
        f"| printed numbers, by committed outcomes | {count_grades(about, False)} |",
        "",
        *(f"- {line}" for line in find_differences(about) or ["no difference"]),
        *(f"- {name}: {run['why']}" for name, run in runs.items() if run["lacks"]),
        *(f"- {name}: a row: {row}" for name, row in kept.items() if row and row != "another"),
        "",
        "The hashes, runs and numbers stand one by one in verification.json.",
        "",
        "Rerun by: ",
    ]
    return "\n".join(lines) + "\n"


def notebook_names(about: dict[str, Any]) -> list[str]:
    """Names of the notebooks."""
    return [name for name in about["runs"] if name != REPORT]
