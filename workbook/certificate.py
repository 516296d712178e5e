"""What a reviewer sends back: what ran here, on what, and whether its results are the committed ones."""

import os
import platform
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from llvmlite import binding

from replication.files import KEPT_SHA256, UserError
from workbook import judging
from workbook.project import ROOT, SETTINGS, find_hook, notebook_sources
from workbook.report import make_report, provenance, refuse_stale
from workbook.stamps import find_why_due, list_kept, list_made, read_stamp, refuse_faults, sha256

ANOTHER = "a row made again is another"
Said = dict[str, dict[str, Any]]  # of each file or printed number
MADE = ("results", "figures", "notebooks/*.ipynb", "README.md")  # as git finds what is made


def certify(full: bool = False) -> dict[str, Any]:
    """Gather what a rerun says; the report is made again.

    Parameters
    ----------
    full : bool
        Whether to make a row of each kept table again.

    Returns
    -------
    dict
        A `summary`, the `differences` from what is committed, and `remarks`; of each notebook its stamp and why it does
        not count as made here; of each result its SHA-256, is it the `same` as committed, was it made here; of data why
        they are not the registered ones; of each kept table what a row made again is; of each number its grade.

    Raises
    ------
    UserError
        No notebook was run here, or this is no clone, which has nothing committed to compare with.
    """
    runs = {name: read_stamp(name) | {"why": find_why_due(name)} for name in notebook_sources()}
    if all(run.get("lacks", "not run") for run in runs.values()):
        raise UserError("no notebook was run here: there is nothing to certify; make all runs them")
    here = [name for name, run in runs.items() if not run["why"]]
    numbers, report, differences = judge_here()
    changed, results = compare_results(report.union(*map(list_made, here)))
    took = sum_up_seconds(runs[name] for name in here)
    data, kept = check_data(), {}
    remarks = {name: run["why"] for name, run in runs.items() if run.get("lacks")}
    differences |= {name: run["why"] for name, run in runs.items() if name not in remarks}
    differences |= dict.fromkeys(changed, "changed since")
    differences |= {name: "not as committed" for name in results if not results[name]["same"]}
    differences["public data"] = "; ".join(sorted({*data.values()} - {""}))
    for name in filter(results.get, list_kept()):
        kept[name] = row = make_row_again(name) if full else ""
        (differences if row == ANOTHER else remarks)[name] = row
    made = [each["same"] for each in results.values() if each["made_here"]]
    unchanged = ", ".join(Path(name).name for name in kept if results[name]["same"]) or "none"
    summary = {
        "commit": _git("rev-parse", "HEAD").strip(),
        "changed since": ", ".join(changed) or "nothing",
        **describe_machine(),
        "notebooks run here with this code": f"{len(here)} of {len(runs)}, {took}",
        "made here and the same": f"{sum(made)} of {len(made)} files that were made here",
        "kept, unchanged, not made here": f"{unchanged}; of what is made, "
        f"{len(results) - len(made) - len(kept)} files were not",
        "sources": f"public data as registered: {[*data.values()].count('')} of {len(data)}",
        "printed numbers, by notebooks run here": count_grades(numbers, here, True),
        "printed numbers, by committed outcomes": count_grades(numbers, here, False),
    }
    return {
        "summary": summary,
        "differences": _list_lines(differences),
        "remarks": _list_lines(remarks),
        "runs": runs,
        "results": results,
        "data": data,
        "kept": kept,
        "numbers": numbers,
    }


def describe_machine() -> dict[str, str]:
    """What it ran on, and when."""
    versions = provenance()["versions"] | {"python": platform.python_version()}
    return {
        "date": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        "machine": f"{platform.platform()}, {binding.get_host_cpu_name()}, {os.cpu_count()} cores",
        "versions": ", ".join(map(" ".join, versions.items())),
    }


def _list_lines(said: Mapping[str, str]) -> list[str]:
    """What is said of notebooks and files, a line each."""
    return [f"{name}: {words}" for name, words in said.items() if words]


def judge_here() -> tuple[Said, set[str], dict[str, str]]:
    """Make the report again: each printed number's grade, the files that it is, and why it can't be made."""
    try:
        refuse_faults()
        report = make_report()
        refuse_stale(report)
    except UserError as error:
        return {}, set(), {"no number is judged": str(error)}
    numbers = judging.verdicts()[["grade", "notebook"]]
    return numbers.to_dict("index"), {file.relative_to(ROOT).as_posix() for file in report}, {}


def compare_results(made_here: set[str]) -> tuple[list[str], Said]:
    """List what changed since the commit; and of what is made its SHA-256, is it the `same`, and was it `made_here`."""
    committed = {*_list("ls-files", "-z", *MADE, f":!results/{KEPT_SHA256}")}
    if not committed:  # in another project's clone
        raise UserError(f"{ROOT}: no clone with a commit: git has nothing of it")
    changed = {*_list("diff", "-z", "--name-only", "--relative", "HEAD")}
    changed |= {*_list("ls-files", "-z", "-o", "--exclude-standard")}
    results = {
        name: {
            "sha256": sha256(ROOT / name),
            "same": name in committed - changed,
            "made_here": name in made_here,
        }
        for name in sorted(made_here | committed)
    }
    return sorted(changed), results


def check_data() -> dict[str, str]:
    """Say of each file of public data why it is not the registered one; "" where it is."""
    said, fetch = {}, find_hook("fetch")
    for name, expected in find_hook("checksums", dict)().items():
        try:
            is_same = sha256(fetch(name)) == expected
            said[name] = "" if is_same else f"{name} is not the registered one"
        except UserError as error:
            said[name] = str(error)
    return said


def make_row_again(table: str) -> str:
    """Make a row of a kept table again, by the settings' module; say how it ended."""
    command = [sys.executable, "-m", SETTINGS["kept"], Path(table).stem]
    variables = os.environ | find_hook("environment", dict)()
    ended = subprocess.run(command, cwd=ROOT, env=variables, capture_output=True, text=True)
    if ended.returncode:
        return f"a row is not made again: {ended.stderr.strip().rpartition(chr(10))[2]}"
    kept = (ROOT / table).read_text("utf-8").splitlines()
    return "a row made again is the same" if {*ended.stdout.splitlines()} <= {*kept} else ANOTHER


def _git(*arguments: str) -> str:
    """What git says of this folder, which may lie in another one's clone."""
    command = ["git", *arguments]
    try:
        return subprocess.check_output(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    except (OSError, subprocess.CalledProcessError) as error:
        why = str(getattr(error, "stderr", error)).partition("\n")[0]
        raise UserError(f"{ROOT}: no clone with a commit to compare with ({why})") from error


def _list(*arguments: str) -> list[str]:
    return _git(*arguments).split("\0")[:-1]


# ------------------------------------------------------------------------------------------------------------ in words


def sum_up_seconds(runs: Iterable[dict[str, Any]]) -> str:
    """Write how long runs took: their sum, and the time in which one of them or more ran."""
    ran = [range(run["ended"] - run["seconds"], run["ended"]) for run in runs]
    wall = len(set().union(*ran))
    return f"{sum(map(len, ran))} s in sum, {wall} s of wall time"


def count_grades(numbers: Said, here: list[str], is_here: bool) -> str:
    """Count printed numbers by how they agree: those of notebooks that ran here, or the others."""
    of = [each for each in numbers.values() if (each["notebook"] in ("", *here)) == is_here]
    counts = Counter(each["grade"] for each in of)  # "": needs no run
    told = (f"{counts[grade]} {grade}" for grade in judging.GRADES)
    return ", ".join(told) if counts else "none"


def write_certificate(about: dict[str, Any]) -> str:
    """A page in Markdown that says what `certify` found."""
    lines = [
        "# Certificate of a rerun",
        "",
        "| | |",
        "|-|-|",
        *(f"| {name} | {words} |" for name, words in about["summary"].items()),
        "",
        *(f"- {line}" for line in (about["differences"] or ["no difference"]) + about["remarks"]),
        "",
        "The hashes, runs and numbers stand one by one in verification.json.",
        "",
        "Rerun by: ",
        "",
    ]
    return "\n".join(lines)
