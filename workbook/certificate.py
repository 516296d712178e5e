"""What a reviewer sends back: what ran here, on what, and whether its results are the committed ones."""

import os
import platform
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any

from llvmlite import binding

from replication.files import KEPT_SHA256, DataUnavailable, UserError
from workbook import judging
from workbook.project import ROOT, SETTINGS, find_hook, notebook_sources
from workbook.report import make_report, provenance, refuse_stale
from workbook.stamps import find_why_due, list_kept, list_made, read_stamp, refuse_faults, sha256


def certify(full: bool = False) -> dict[str, Any]:
    """Gather what a rerun says. The report is made again here, and compared.

    Parameters
    ----------
    full : bool
        Whether a row of each kept table is made again.

    Returns
    -------
    dict
        `commit` and what is `changed` since; date, machine, versions; of each notebook why it does not count as made
        here ("" if it does), its seconds, and what it `lacks`; of each committed result, figure and notebook its
        SHA-256, whether it is the `same` as committed, and whether it was made here; of each file of public data why
        it is not the registered one; of each kept table what a row made again is; of each printed number how it
        agrees, and by which notebook; or why none is judged.

    Raises
    ------
    UserError
        No notebook was run here, or this is no clone, which has nothing committed to compare with.
    """
    nothing = {"seconds": 0.0, "ended": 0.0, "lacks": "", "record": ""}
    runs = {
        name: nothing | read_stamp(name) | {"why": find_why_due(name)}
        for name in notebook_sources()
    }
    if not any(run["record"] for run in runs.values()):
        raise UserError("no notebook was run here: there is nothing to certify; make all runs them")
    made_here = {file for name in _list_here(runs) for file in list_made(name)}
    unjudged, numbers = "", {}
    try:
        refuse_faults()
        report = make_report()
        refuse_stale(report)
        made_here |= {file.relative_to(ROOT).as_posix() for file in report}
        verdicts = judging.verdicts()
        graded = verdicts.assign(grade=judging.grade(verdicts))
        numbers = graded[["grade", "notebook"]].to_dict("index")
    except UserError as error:
        unjudged = str(error)
    committed = {*_list("ls-files", "-z", "results", "figures", "notebooks", "README.md")}
    if not committed:
        raise UserError(f"{ROOT}: no clone with a commit: git has nothing of it")
    changed = {*_list("diff", "-z", "--name-only", "--relative", "HEAD")}
    changed |= {*_list("ls-files", "-z", "-o", "--exclude-standard")}
    results = {
        name: {
            "sha256": sha256(ROOT / name),
            "same": name in committed - changed,
            "made_here": name in made_here,
        }
        for name in sorted(made_here | {each for each in committed if _is_result(each)})
    }
    return {
        "commit": _git("rev-parse", "HEAD").strip(),
        "changed": sorted(changed),
        "date": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        "machine": f"{platform.platform()}, {binding.get_host_cpu_name()}, {os.cpu_count()} cores",
        "versions": provenance()["versions"] | {"python": platform.python_version()},
        "runs": runs,
        "data": check_data(),
        "results": results,
        "kept": {
            name: make_row_again(name) if full else "" for name in list_kept() if name in results
        },
        "numbers": numbers,
        "unjudged": unjudged,
    }


def _list_here(runs: dict[str, dict[str, Any]]) -> list[str]:
    """Names of the notebooks that count as made here."""
    return [name for name, run in runs.items() if not run["why"]]


def _is_result(name: str) -> bool:
    """Whether a committed file is one that is made: not a source, nor a page that a person writes."""
    if name.endswith(KEPT_SHA256):
        return False
    return name == "README.md" or not name.startswith("notebooks/") or name.endswith(".ipynb")


def check_data() -> dict[str, str]:
    """Say of each file of public data why it is not the registered one; "" where it is."""
    registered, fetch = find_hook("checksums", dict)(), find_hook("fetch")
    faults = {}
    for name, expected in registered.items():
        try:
            is_same = sha256(fetch(name)) == expected
            faults[name] = "" if is_same else f"{name} is not the registered one"
        except DataUnavailable as error:
            return dict.fromkeys(registered, str(error))
        except UserError as error:
            faults[name] = str(error)
    return faults


def make_row_again(table: str) -> str:
    """Make a row of a kept table again, by the settings' module: "same", "another", or why it is not made."""
    command = [sys.executable, "-m", SETTINGS["kept"], os.path.basename(table)[:-4]]
    variables = os.environ | find_hook("environment", dict)()
    ended = subprocess.run(command, cwd=ROOT, env=variables, capture_output=True, text=True)
    if ended.returncode:
        return f"not made again: {ended.stderr.strip().rpartition(chr(10))[2]}"
    kept = (ROOT / table).read_text("utf-8").splitlines()
    return "same" if {*ended.stdout.splitlines()} <= {*kept} else "another"


def _git(*arguments: str) -> str:
    """What git says of this folder, which may lie in another one's clone."""
    try:
        ended = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True)
    except OSError as error:
        raise UserError(f"git is needed, to compare with what is committed ({error})") from error
    if ended.returncode:
        why = ended.stderr.decode().partition("\n")[0]
        raise UserError(f"{ROOT}: no clone with a commit: {why}")
    return ended.stdout.decode()


def _list(*arguments: str) -> list[str]:
    return _git(*arguments).split("\0")[:-1]


# ------------------------------------------------------------------------------------------------------------ in words


def find_differences(about: dict[str, Any]) -> list[str]:
    """Say in a line each what a rerun did not make as it is committed, and what it did not run."""
    results = about["results"]
    lines = {name: run["why"] for name, run in about["runs"].items() if not run["lacks"]}
    lines |= {name: "" if each["same"] else "not as committed" for name, each in results.items()}
    lines |= {name: "changed since" for name in about["changed"] if name not in results}
    again = [name for name, row in about["kept"].items() if row == "another"]
    return [
        *(f"{name}: {why}" for name, why in lines.items() if why),
        *(f"{name}: a row made again is another" for name in again),
        *([f"no number is judged: {about['unjudged']}"] if about["unjudged"] else []),
        *(f"public data: {why}" for why in dict.fromkeys(about["data"].values()) if why),
    ]


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
    here = {"", *_list_here(about["runs"])}  # "": needs no run
    numbers = about["numbers"].values()
    grades = Counter(each["grade"] for each in numbers if (each["notebook"] in here) == is_here)
    return ", ".join(f"{grades[each]} {each}" for each in judging.GRADES) if grades else "none"


def write_certificate(about: dict[str, Any]) -> str:
    """A page in Markdown that says what `certify` found."""
    results, kept, runs = about["results"], about["kept"], about["runs"]
    here = _list_here(runs)
    made = [each["same"] for each in results.values() if each["made_here"]]
    unchanged = [os.path.basename(name) for name in kept if results[name]["same"]]
    others = len(results) - len(made) - len(kept)
    files = [not why for why in about["data"].values()]
    rows = {
        "commit": about["commit"],
        "changed since": ", ".join(about["changed"]) or "nothing",
        "date": about["date"],
        "machine": about["machine"],
        "versions": ", ".join(f"{name} {each}" for name, each in about["versions"].items()),
        "notebooks run here with this code": f"{len(here)} of {len(runs)}, "
        + sum_up_seconds(runs[name] for name in here),
        "made here and the same": f"{sum(made)} of {len(made)} files that were made here",
        "kept, unchanged, not made here": f"{', '.join(unchanged) or 'none'}; "
        f"of what is made, {others} files were not",
        "sources": f"public data as registered: {sum(files)} of {len(files)}",
        "printed numbers, by notebooks run here": count_grades(about, True),
        "printed numbers, by committed outcomes": count_grades(about, False),
    }
    lines = [
        "# Certificate of a rerun",
        "",
        "| | |",
        "|-|-|",
        *(f"| {name} | {words} |" for name, words in rows.items()),
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
