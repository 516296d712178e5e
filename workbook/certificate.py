"""What a reviewer sends back: what ran here, on what, and whether its results are the committed ones."""

import os
import platform
import subprocess
from datetime import UTC, datetime
from typing import Any

from llvmlite import binding

from replication.files import ROOT, DataUnavailable, UserError
from replication.records import AUTHORS_FILES, authors_checksums, authors_file
from workbook import judging
from workbook.provenance import provenance
from workbook.sources import RESULTS, listed_exports, notebook_sources
from workbook.stamps import changed_files, read_stamp, sha256, sha256_of


def certify() -> dict[str, Any]:
    """Gather what a rerun says.

    Returns
    -------
    dict
        `commit` and what is `changed` since; date, machine, versions; of each notebook whether it
        `ran_here`, its seconds, and what is no longer as it made it; of each committed result, figure and notebook
        and of each of the authors' files two SHA-256, as measured and as committed or registered, and
        whether they are the `same`; the verdicts.

    Raises
    ------
    UserError
        No notebook was run here, or this is no clone, which has nothing committed to compare with.
    """
    notebooks = {name: _run_of(name) for name in notebook_sources()}
    if not any(each["ran_here"] for each in notebooks.values()):
        raise UserError("no notebook was run here: there is nothing to certify; make all runs them")
    names = {name for source in notebook_sources().values() for name in listed_exports(source)}
    names |= {
        "README.md",
        *_git("ls-files", "results", "figures", "notebooks").decode().splitlines(),
    }
    verdicts = judging.verdicts(RESULTS).set_index("id")["agreement"]
    return {
        "commit": _git("rev-parse", "HEAD").decode().strip(),
        "changed": [line[3:] for line in _git("status", "--porcelain").decode().splitlines()],
        "date": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        "machine": f"{platform.platform()}, {binding.get_host_cpu_name()}, {os.cpu_count()} cores",
        "versions": provenance()["versions"] | {"python": platform.python_version()},
        "notebooks": notebooks,
        "authors_files": _authors_files(),
        "results": {
            name: _compare(sha256(ROOT / name), sha256_of(_git("show", f"HEAD:{name}")))
            for name in sorted(names)
        },
        "verdicts": verdicts.to_dict(),
    }


def _run_of(name: str) -> dict[str, Any]:
    stamp = ROOT / ".make" / f"{name}.ran"
    ran, changed = read_stamp(stamp), changed_files(ROOT, stamp)
    return {"ran_here": bool(ran["made"]), "seconds": ran["seconds"], "changed_since": changed}


def _compare(measured: str, expected: str) -> dict[str, Any]:
    return {"measured": measured, "expected": expected, "same": measured == expected}


def _authors_files() -> dict[str, dict[str, Any]]:
    """Hashes of the authors' files; in place of those that cannot be had, why."""
    registered = authors_checksums()
    measured: dict[str, str] = {}
    for name in AUTHORS_FILES:
        try:
            measured[name] = sha256(authors_file(name))
        except DataUnavailable as error:
            measured |= dict.fromkeys(AUTHORS_FILES, str(error))
            break
        except UserError as error:
            measured[name] = str(error)
    return {name: _compare(measured[name], registered[name]) for name in AUTHORS_FILES}


def _git(*arguments: str) -> bytes:
    """What git prints; nothing of a file that is not committed."""
    try:
        ended = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True)
    except OSError as error:
        raise UserError(f"git is needed, to compare with what is committed ({error})") from error
    if ended.returncode and arguments[0] != "show":
        raise UserError(f"this is no clone with a commit: {ended.stderr.decode().splitlines()[0]}")
    return ended.stdout


def find_differences(about: dict[str, Any]) -> list[str]:
    """Say in a line each what a rerun did not make as it is committed, and what it did not run."""
    lines = [
        f"{name}: not run here" for name, ran in about["notebooks"].items() if not ran["ran_here"]
    ]
    results, files = about["results"], about["authors_files"]
    lines += [f"{name}: not as committed" for name, each in results.items() if not each["same"]]
    reasons = [each["measured"] for each in files.values() if not each["same"]]
    return lines + [f"authors' files: {reason}" for reason in dict.fromkeys(reasons)]


def write_certificate(about: dict[str, Any]) -> str:
    """A page in Markdown that says what `certify` found."""
    counts = {
        kind: f"{sum(each['same'] for each in about[kind].values())} of {len(about[kind])}"
        for kind in ("results", "authors_files")
    }
    ran = [each["seconds"] for each in about["notebooks"].values() if each["ran_here"]]
    agreements = [*about["verdicts"].values()]
    verdicts = ", ".join(f"{agreements.count(each)} {each}" for each in judging.AGREEMENTS)
    versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items())
    changed = ", ".join(about["changed"]) or "nothing"
    lines = [
        "# Certificate of a rerun",
        "",
        "| | |",
        "|-|-|",
        f"| commit | {about['commit']}, changed since: {changed} |",
        f"| date | {about['date']} |",
        f"| machine | {about['machine']} |",
        f"| versions | {versions} |",
        f"| notebooks that ran here | {len(ran)} of {len(about['notebooks'])}, {sum(ran):.0f} s |",
        f"| authors' files as registered | {counts['authors_files']} |",
        f"| results, figures and notebooks as committed | {counts['results']} |",
        f"| printed numbers | {verdicts} |",
        "",
        *(f"- {line}" for line in find_differences(about) or ["no difference"]),
        "",
        "The hashes, notebooks and verdicts stand one by one in verification.json.",
        "",
        "Rerun by: ",
    ]
    return "\n".join(lines) + "\n"
