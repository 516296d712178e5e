"""What a notebook and the report were made from, and what they made: is it so still? Content decides, never a time.

A record is committed: the outcome of a notebook, `results/outcomes/NAME.json`, and of the report
`results/provenance.json`. It holds `made_from`, one SHA-256 of all inputs: the notebook's source, the packages that it
may import, the lock, the workbook's settings, and the files that the run itself has noted as it read them (`read`);
and `made`, the SHA-256 of each file that it made. A stamp, `.make/NAME.ran`, is what a run leaves here: its seconds,
and the SHA-256 of all that it made, with the record.

No inputs are: the versions of Python and of a processor, on which results do not depend; the paper's data, whose
SHA-256 a package holds; hidden files and those that nothing can import; the report's template, of a notebook.

By the standard library alone: `make all` asks, each time, what is due.
"""

import csv
import hashlib
import json
import re
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from replication.files import UserError, write_text
from workbook.project import ROOT, notebook_sources, read_settings

REPORT = "report"
RECORD = ("made_from", "read", "made")
SAID = "what is said"  # in a record, among the files: the rest of its own one
# Of whatever stands where JSON should.
UNREADABLE = (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError)
# A module that can be imported, or a file that a program can name: no copy, backup or file of an editor.
INPUT = re.compile(r"\w+\.(py|csv|json|txt)", re.ASCII)


def sha256_of(content: bytes) -> str:
    """SHA-256 of some bytes."""
    return hashlib.sha256(content).hexdigest()


def sha256(file: Path) -> str:
    """SHA-256 of a file; "" where none can be read."""
    try:
        return sha256_of(file.read_bytes())
    except OSError:
        return ""


# ----------------------------------------------------------------------------------------------- what it was made from


def list_code(project: Path) -> Iterator[Path]:
    """List the files of the packages that a notebook may import."""
    for package in read_settings(project).get("packages", ()):
        for file in (project / package).rglob("*.*"):
            if INPUT.fullmatch(file.name) and file.is_file():
                yield file


def digest_code(project: Path, source: Path | None = None) -> dict[str, str]:
    """SHA-256, by name, of all that is known before a run: source, packages, lock and settings."""
    files = [*list_code(project), project / "requirements.lock", *([source] if source else [])]
    settings = json.dumps(read_settings(project), sort_keys=True)
    digests = {file.relative_to(project).as_posix(): sha256(file) for file in files}
    return digests | {"tool.workbook": sha256_of(settings.encode())}


def digest_inputs(code: Mapping[str, str], read: Mapping[str, str]) -> str:
    """One SHA-256 of what a run is made from, by the SHA-256 of each input."""
    return sha256_of(json.dumps(dict(code) | dict(read), sort_keys=True).encode())


def add_record(
    said: Mapping[str, Any],
    code: Mapping[str, str],
    read: Mapping[str, str],
    made: Mapping[str, bytes],
) -> dict[str, Any]:
    """Add to what a run says what it was made from, and what it made, by names from the project's folder."""
    other = {name: digest for name, digest in read.items() if name not in made}
    files = {name: sha256_of(made[name]) for name in sorted(made)}
    record = {"made_from": digest_inputs(code, other), "read": sorted(other)}
    return {**said, **record, "made": {SAID: digest_said(said)} | files}


def digest_said(said: Mapping[str, Any]) -> str:
    """SHA-256 of what a run says, without the record."""
    left = {name: value for name, value in said.items() if name not in RECORD}
    return sha256_of(json.dumps(left, sort_keys=True).encode())


def record_file(project: Path, name: str) -> Path:
    """Name the file that says what a notebook, or the report, was made from."""
    results = project / "results"
    return results / ("provenance.json" if name == REPORT else f"outcomes/{name}.json")


def read_record(project: Path, name: str) -> dict[str, Any]:
    """Read the record of a notebook, or of the report; empty where there is none."""
    try:
        held = json.loads(record_file(project, name).read_text("utf-8"))
        return {
            "made_from": str(held["made_from"]),
            "read": [*map(str, held["read"])],
            "made": {str(file): str(digest) for file, digest in held["made"].items()},
            SAID: digest_said(held),
        }
    except UNREADABLE:
        return {}


def find_fault(project: Path, name: str) -> str:
    """Say what is not as the record of a notebook, or of the report, says; "" where all is."""
    record = read_record(project, name)
    if not record:
        file = record_file(project, name).relative_to(project)
        return f"{file} is missing, or says not what it was made from"
    for file, digest in record["made"].items():
        if (record[SAID] if file == SAID else sha256(project / file)) != digest:
            return f"{file} is missing, or not as it was made"
    source = None if name == REPORT else notebook_sources(project)[name]
    read = {file: sha256(project / file) for file in record["read"]}
    is_same = record["made_from"] == digest_inputs(digest_code(project, source), read)
    return "" if is_same else MADE_BY_OTHER


MADE_BY_OTHER = "made by other code or tables than those that are there"


def refuse_faults(project: Path = ROOT, names: Iterable[str] = ()) -> None:
    """Refuse to go on where results are missing, or are not those of the code and the tables that are there.

    What is missing is never judged; nor what a notebook had made before it was removed, or changed. A notebook that
    hands the report nothing may be one that cannot run here: it may be older than the code.
    """
    sources = notebook_sources(project)
    for file in sorted((project / "results" / "outcomes").glob("*.json")):
        if file.stem not in sources:
            raise UserError(
                f"{file.relative_to(project)}: no notebook makes it; git checkout brings the notebook "
                "back, or delete it"
            )
    for name in names or sources:
        fault = find_fault(project, name)
        if fault and (fault != MADE_BY_OTHER or speaks(project, name)):
            raise UserError(f"{name}: {fault}; make all makes it")


def speaks(project: Path, name: str) -> bool:
    """Whether a notebook hands the report anything; the report always does."""
    outcome = json.loads(record_file(project, name).read_text("utf-8"))
    return name == REPORT or any(outcome.get(each) for each in ("cells", "claims", "facts"))


# -------------------------------------------------------------------------------------------------- what was made here


def new_stamp(project: Path, files: Iterable[Path], seconds: float = 0.0, lacks: str = "") -> bytes:
    """Describe what a run has made in a project, as a stamp holds it; or what it lacked."""
    made = {file.relative_to(project).as_posix(): sha256(file) for file in sorted(files)}
    times = {"seconds": round(seconds), "ended": round(time.time())}
    return (json.dumps({**times, "lacks": lacks, "made": made}, indent=1) + "\n").encode()


def stamp_file(project: Path, name: str) -> Path:
    """Name the stamp of a notebook, or of the report."""
    return project / ".make" / f"{name}.ran"


def read_stamp(project: Path, name: str) -> dict[str, Any]:
    """What a stamp holds; nothing where there is none."""
    try:
        held = json.loads(stamp_file(project, name).read_text("utf-8"))
        times = {each: float(held[each]) for each in ("seconds", "ended")}
        return {**times, "lacks": str(held["lacks"]), "made": dict(held["made"])}
    except UNREADABLE:
        return {"seconds": 0.0, "ended": 0.0, "lacks": "", "made": {}}


def find_why_due(project: Path, name: str) -> str:
    """Say why a notebook, or the report, has not been made here as it would be now; "" where it has."""
    stamp = read_stamp(project, name)
    made = stamp["made"]
    if not made:
        return f"not run: {stamp['lacks']}" if stamp["lacks"] else "not run here"
    for file, digest in made.items():
        if sha256(project / file) != digest:
            return f"{file} is not as it was made here"
    fault = find_fault(project, name)
    return "not run here with this code" if fault == MADE_BY_OTHER else fault


def find_due(project: Path = ROOT) -> list[Path]:
    """Find the sources of notebooks that are due, the longest first, as a table of times has them."""
    try:
        with (project / "results" / "notebook_times.csv").open(encoding="utf-8") as file:
            seconds = {row["notebook"]: float(row["seconds"]) for row in csv.DictReader(file)}
    except (OSError, ValueError, KeyError, TypeError):
        seconds = {}
    sources = notebook_sources(project)
    due = [name for name in sources if find_why_due(project, name)]
    return [sources[name] for name in sorted(due, key=lambda name: -seconds.get(name, 0))]


def drop_stale_caches(project: Path = ROOT) -> None:
    """Remove compiled code of the packages if they have changed since the last run.

    Python and numba go by a file's time and size, and numba freezes the constants of other files.
    """
    mark = project / ".make" / "code.sha256"
    digest = digest_inputs(digest_code(project), {})
    if mark.is_file() and mark.read_text("utf-8") == digest:
        return
    for package in read_settings(project).get("packages", ()):
        for folder in (project / package).rglob("__pycache__"):
            shutil.rmtree(folder, ignore_errors=True)
    write_text(mark, digest)
