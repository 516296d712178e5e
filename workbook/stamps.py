"""What a notebook was made from, and what it made: is it so still? Content decides, never a time.

A record is committed: the outcome of a notebook, `results/outcomes/NAME.json`. It holds `made_from`, one SHA-256 of
all inputs: the notebook's source, the packages that it may import, the lock, the workbook's settings, and the files
that the run itself has noted as it read them (`read`); and `made`, the SHA-256 of each file that it made. A stamp,
`.make/NAME.ran`, is what a run leaves here: its seconds, and the SHA-256 of the record.

No inputs are: the versions of Python and of a processor, on which results do not depend; the paper's data, whose
SHA-256 a package holds; hidden files and those that nothing can import; the report's template. The report has no stamp:
`make all` makes it each time, and `make check` compares it with what the results say.

By the standard library alone: `make all` asks, each time, what is due.
"""

import csv
import hashlib
import json
import re
import shutil
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from replication.files import (
    KEPT_SHA256,
    UserError,
    as_json,
    check_kept,
    read_committed,
    write_bytes,
    write_text,
)
from workbook.project import RESULTS, ROOT, SETTINGS, notebook_sources

RECORD = ("made_from", "read", "made")
STAMP = ("seconds", "ended", "lacks", "record")
SAID = "what is said"  # in a record, among the files: the rest of its own one
NOTHING: dict[str, Any] = {"cells": [], "claims": [], "facts": {}}  # that is said
MADE_BY_OTHER = "made by other code or tables than those that are there"
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


def digest(content: Mapping[str, Any]) -> str:
    """SHA-256 of names and values, in whichever order."""
    return sha256_of(json.dumps(content, sort_keys=True).encode())


# ----------------------------------------------------------------------------------------------- what it was made from


def digest_code(*sources: Path) -> dict[str, str]:
    """SHA-256, by name, of all that is known before a run: sources, packages, lock and settings."""
    folders = [ROOT / package for package in SETTINGS.get("packages", ())]
    code = [file for each in folders for file in each.rglob("*.*") if INPUT.fullmatch(file.name)]
    files = [*code, ROOT / "requirements.lock", *sources]
    digests = {file.relative_to(ROOT).as_posix(): sha256(file) for file in files}
    return digests | {"tool.workbook": digest(SETTINGS)}


def add_record(
    said: Mapping[str, Any],
    code: Mapping[str, str],
    read: Mapping[str, str],
    made: Mapping[str, bytes],
) -> dict[str, Any]:
    """Add to what a run says what it was made from, and what it made, by names from the project's folder."""
    other = {name: each for name, each in read.items() if name not in made}
    files = {name: sha256_of(made[name]) for name in sorted(made)}
    record = {"made_from": digest({**code, **other}), "read": sorted(other)}
    return {**said, **record, "made": {SAID: digest(said), **files}}


def record_name(name: str) -> str:
    """Name, from the project's folder, the file that says what a notebook was made from."""
    return f"results/outcomes/{name}.json"


def record_file(name: str) -> Path:
    """Find the file that says what a notebook was made from."""
    return ROOT / record_name(name)


def stamp_file(name: str) -> Path:
    """Name the stamp of a notebook."""
    return ROOT / ".make" / f"{name}.ran"


def _read_json(file: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """Read some names of a JSON file, and the SHA-256 of the rest; empty where it has not all of them."""
    try:
        held = json.loads(file.read_text("utf-8"))
        return {name: held.pop(name) for name in names} | {SAID: digest(held)}
    except Exception:  # of whatever stands where JSON should
        return {}


def read_record(name: str) -> dict[str, Any]:
    """Read the record of a notebook; empty where there is none."""
    return _read_json(record_file(name), RECORD)


def list_made(name: str) -> set[str]:
    """List what a notebook has made, by names from the project's folder, with its record."""
    return {record_name(name), *read_record(name)["made"]} - {SAID}


def list_kept() -> list[str]:
    """List the tables that `make all` does not make, by names from the project's folder."""
    file = RESULTS / KEPT_SHA256
    kept = read_committed(file, json.loads) if file.exists() else ()
    return [f"results/{name}" for name in kept]


def find_fault(name: str) -> str:
    """Say what is not as the record of a notebook says; "" where all is."""
    record = read_record(name)
    if not record:
        return f"{record_name(name)} is missing, or says not what it was made from"
    for file, expected in record["made"].items():
        if (record[SAID] if file == SAID else sha256(ROOT / file)) != expected:
            return f"{file} is missing, or not as it was made"
    read = {file: sha256(ROOT / file) for file in record["read"]}
    inputs = digest_code(notebook_sources()[name]) | read
    return "" if record["made_from"] == digest(inputs) else MADE_BY_OTHER


def refuse_faults() -> None:
    """Refuse to go on where results are missing, or are not those of the code and the tables that are there.

    What is missing is never judged; nor what a notebook had made before it was removed, or changed. A notebook that
    hands the report nothing may be one that cannot run here: it may be older than the code.
    """
    sources = notebook_sources()
    outcomes = {file.stem for file in (RESULTS / "outcomes").glob("*.json")}
    for name in sorted(outcomes - sources.keys()):
        raise UserError(
            f"{record_name(name)}: no notebook makes it; git checkout brings the notebook "
            "back, or delete it"
        )
    for table in list_kept():
        check_kept(ROOT / table)
    for name in sources:
        fault = find_fault(name)
        if fault and not (fault == MADE_BY_OTHER and read_record(name)[SAID] == digest(NOTHING)):
            raise UserError(f"{name}: {fault}; make all makes it")


# -------------------------------------------------------------------------------------------------- what was made here


def write_stamp(name: str, seconds: float = 0.0, lacks: str = "") -> None:
    """Write how long a notebook ran that has left a record; or what it lacked."""
    stamp = {"seconds": round(seconds), "ended": round(time.time()), "lacks": lacks}
    write_bytes(stamp_file(name), as_json(stamp | {"record": sha256(record_file(name))}))


def read_stamp(name: str) -> dict[str, Any]:
    """What a stamp holds; empty where there is none."""
    return _read_json(stamp_file(name), STAMP)


def find_why_due(name: str) -> str:
    """Say why a notebook has not been made here as it would be now; "" where it has."""
    stamp = read_stamp(name)
    if not stamp:
        return "not run here"
    if stamp["lacks"]:
        return f"not run: {stamp['lacks']}"
    if sha256(record_file(name)) != stamp["record"]:
        return f"{record_name(name)} is not as it was made here"
    return find_fault(name)


def find_due() -> list[Path]:
    """Find the sources of notebooks that are due, the longest first, as a table of times has them."""
    times = RESULTS / "notebook_times.csv"
    seconds = read_committed(times, _read_times) if times.exists() else {}
    due = [source for name, source in notebook_sources().items() if find_why_due(name)]
    return sorted(due, key=lambda source: -seconds.get(source.stem, 0))


def _read_times(text: str) -> dict[str, float]:
    rows = csv.DictReader(text.splitlines())
    return {row["notebook"]: float(row["seconds"]) for row in rows}


def drop_stale_caches() -> None:
    """Remove compiled code of the packages if they have changed since the last run.

    Python and numba go by a file's time and size, and numba freezes the constants of other files.
    """
    mark = ROOT / ".make" / "code.sha256"
    now = digest(digest_code())
    if mark.is_file() and mark.read_text("utf-8") == now:
        return
    for package in SETTINGS.get("packages", ()):
        for folder in (ROOT / package).rglob("__pycache__"):
            shutil.rmtree(folder, ignore_errors=True)
    write_text(mark, now)
