"""What a reviewer sends back: what ran here, on what, and whether its results are the committed ones."""

import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

import pandas as pd
from llvmlite import binding

from replication.files import KEPT_SHA256, DataUnavailable, UserError
from workbook import judging
from workbook.project import ROOT, SETTINGS, find_hook, notebook_sources
from workbook.report import make_report, provenance, refuse_stale
from workbook.stamps import find_why_due, list_kept, list_made, read_stamp, refuse_faults, sha256

MADE = ("results", "figures", "notebooks/*.ipynb", "README.md")  # as git finds what is made
ANOTHER = "another"  # row than the kept one
Texts = Mapping[str, Any]  # by the name of a notebook or file


def certify(full: bool = False) -> dict[str, Any]:
    """Gather what a rerun says. The report is made again here, and compared.

    Parameters
    ----------
    full : bool
        Whether to make a row of each kept table again.

    Returns
    -------
    dict
        A `summary` in words, the `differences` from what is committed, and `remarks`; of each notebook why it does not
        count as made here, and its stamp; of each result its SHA-256, is it the `same` as committed, was it made here;
        of each file of public data why it is not the registered one; of each kept table what a row made again is; of
        each printed number how it agrees, and by which notebook.

    Raises
    ------
    UserError
        No notebook was run here, or this is no clone, which has nothing committed to compare with.
    """
    runs = {name: read_stamp(name) | {"why": find_why_due(name)} for name in notebook_sources()}
    if not any(run.get("record") for run in runs.values()):
        raise UserError("no notebook was run here: there is nothing to certify; make all runs them")
    here = [name for name, run in runs.items() if not run["why"]]
    made_here = {file for name in here for file in list_made(name)}
    numbers, files, differences = judge_here()
    changed, results = compare_results(made_here | files)
    tables = [name for name in list_kept() if name in results.index]
    kept = {name: make_row_again(name) if full else "" for name in tables}
    data = check_data()
    differences += list_differences(runs, changed, results, kept, data)
    remarks = [f"{name}: {run['why']}" for name, run in runs.items() if run.get("lacks")]
    remarks += [f"{name}: a row: {row}" for name, row in kept.items() if row not in ("", ANOTHER)]
    is_here = numbers["notebook"].isin(["", *here])  # "": needs no run
    made = results[results["made_here"]]
    unchanged = ", ".join(os.path.basename(name) for name in kept if results["same"][name])
    summary = {
        "commit": _git("rev-parse", "HEAD").strip(),
        "changed since": ", ".join(changed) or "nothing",
        **describe_machine(),
        "notebooks run here with this code": f"{len(here)} of {len(runs)}, "
        f"{sum_up_seconds(runs[name] for name in here)}",
        "made here and the same": f"{made['same'].sum()} of {len(made)} files that were made here",
        "kept, unchanged, not made here": f"{unchanged or 'none'}; of what is made, "
        f"{len(results) - len(made) - len(kept)} files were not",
        "sources": f"public data as registered: {[*data.values()].count('')} of {len(data)}",
        "printed numbers, by notebooks run here": count_grades(numbers.loc[is_here, "grade"]),
        "printed numbers, by committed outcomes": count_grades(numbers.loc[~is_here, "grade"]),
    }
    return {
        "summary": summary,
        "differences": differences,
        "remarks": remarks,
        "runs": runs,
        "results": results.to_dict("index"),
        "data": data,
        "kept": kept,
        "numbers": numbers.to_dict("index"),
    }


def judge_here() -> tuple[pd.DataFrame, set[str], list[str]]:
    """Make the report again: the printed numbers' grades, the files that it is, and why it can't be made."""
    try:
        refuse_faults()
        report = make_report()
        refuse_stale(report)
    except UserError as error:
        nothing = pd.DataFrame(columns=["grade", "notebook"])
        return nothing, set(), [f"no number is judged: {error}"]
    numbers = judging.verdicts()[["grade", "notebook"]]
    return numbers, {file.relative_to(ROOT).as_posix() for file in report}, []


def describe_machine() -> dict[str, str]:
    """What it ran on, and when."""
    versions = provenance()["versions"] | {"python": platform.python_version()}
    return {
        "date": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        "machine": f"{platform.platform()}, {binding.get_host_cpu_name()}, {os.cpu_count()} cores",
        "versions": ", ".join(f"{name} {each}" for name, each in versions.items()),
    }


def list_differences(
    runs: Texts, changed: list[str], results: pd.DataFrame, kept: Texts, data: Texts
) -> list[str]:
    """Say in a line each what a rerun did not make as it is committed, and what it did not run."""
    lines = {name: run["why"] for name, run in runs.items() if not run.get("lacks")}
    lines |= dict.fromkeys(results.index[~results["same"]], "not as committed")
    lines |= dict.fromkeys([name for name in changed if name not in results.index], "changed since")
    lines |= dict.fromkeys(
        [name for name in kept if kept[name] == ANOTHER], f"a row made again is {ANOTHER}"
    )
    of_data = [f"public data: {why}" for why in dict.fromkeys(data.values()) if why]
    return [f"{name}: {why}" for name, why in lines.items() if why] + of_data


def compare_results(made_here: set[str]) -> tuple[list[str], pd.DataFrame]:
    """List what changed since the commit; and of what is made its SHA-256, is it the `same`, and was it `made_here`."""
    committed = {*_list("ls-files", "-z", *MADE, f":!results/{KEPT_SHA256}")}
    if not committed:
        raise UserError(f"{ROOT}: no clone with a commit: git has nothing of it")
    changed = {*_list("diff", "-z", "--name-only", "--relative", "HEAD")}
    changed |= {*_list("ls-files", "-z", "-o", "--exclude-standard")}
    names = sorted(made_here | committed)
    table = pd.DataFrame({"sha256": [sha256(ROOT / name) for name in names]}, names)
    table["same"] = table.index.isin(committed - changed)
    return sorted(changed), table.assign(made_here=table.index.isin(made_here))


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
    return "same" if {*ended.stdout.splitlines()} <= {*kept} else ANOTHER


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


def sum_up_seconds(runs: Iterable[dict[str, Any]]) -> str:
    """Write how long runs took: their sum, and the time in which one of them or more ran."""
    wall, until = 0.0, 0.0
    ran = sorted((run["ended"] - run["seconds"], run["ended"]) for run in runs)
    for start, end in ran:
        wall += max(0.0, end - max(start, until))
        until = max(until, end)
    return f"{sum(end - start for start, end in ran):.0f} s in sum, {wall:.0f} s of wall time"


def count_grades(grades: pd.Series) -> str:
    """Count printed numbers by how they agree."""
    counts = grades.value_counts()
    return (
        ", ".join(f"{counts.get(each, 0)} {each}" for each in judging.GRADES if len(grades))
        or "none"
    )


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
    ]
    return "\n".join(lines) + "\n"
