"""The report: the project's template with the results' numbers filled in; and the list of `make check`."""

import html
import re
import sys
from collections import ChainMap, Counter
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd

from replication.files import UserError, as_csv, as_json, read_committed
from workbook import judging
from workbook.outcomes import load_outcomes, read_kept, read_table
from workbook.project import RESULTS, ROOT, SETTINGS, find_hook

TEMPLATE = ROOT / SETTINGS["report"]
README = ROOT / "README.md"
# What stands between one pair of marks, and no other mark.
STATUS = re.compile(
    r"(?<=<!-- status: begin -->\n)((?!<!-- status).)*(?=<!-- status: end -->)", re.DOTALL
)
VERDICTS = ("agrees", "agrees weakly", "differs", "not tested")
# Columns of the tables that are written.
OF_CELLS = [
    "id",
    "printed",
    "published",
    "reproduced",
    "low",
    "high",
    "agreement",
    "weak",
    "source",
    "resolution",
    "reason",
    "notebook",
]
OF_CLAIMS = ["id", "of", "quote", "reading", "section", "verdict", "measured", "notebook"]
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
GREEK = re.compile(r"\b(alpha|delta|lambda|mu|omega|pi|sigma|tau)(?=\b|_)")
ABSENT = re.compile(r"\b(nan|None|inf)\b")
POWER = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)e([+-]?\d+)\b")

# ------------------------------------------------------------------------------------------------- numbers in words


def typeset(text: object) -> str:
    """Write powers of ten as 5.9·10⁻⁶ or 10⁵, Greek letters and a minus sign before a number as such."""
    text = html.unescape(GREEK.sub(r"&\1;", str(text))).replace("dtheta", "Δθ")
    raised = POWER.sub(lambda e: f"{e[1]}·10{str(int(e[2])).translate(RAISED)}", text)
    raised = re.sub(r"(?<![\d.])1·10", "10", raised)
    return re.sub(r"(?<![\w)\]])-(?=[\d.])", "−", raised)


def span(numbers: Sequence[float], form: str) -> str:
    """Write the smallest and the largest of some numbers: "2.5 to 4.4"; the one where they look alike, or "none"."""
    ends = [format(end, form) for end in (min(numbers), max(numbers))] if len(numbers) else ["none"]
    return " to ".join(dict.fromkeys(ends))


# ------------------------------------------------------------------------------------------------ what the text has


def count_by(cells: pd.DataFrame, key: str) -> pd.DataFrame:
    """Count printed numbers by agreement, and by "element" or "source", in their order, with a row for "all"."""
    counts = pd.crosstab(cells[key], cells["shown"], margins=True, margins_name="all")
    order = [*cells[key].unique(), "all"]
    return counts.reindex(index=order, columns=VERDICTS, fill_value=0)


def measured_seconds(cells: pd.DataFrame) -> dict[str, int]:
    """Run time of the notebooks that make an element's numbers [s], where `results/notebook_times.csv` has it."""
    if not (RESULTS / "notebook_times.csv").exists():
        return {}
    seconds = read_kept("notebook_times").set_index("notebook")["seconds"]
    makers = cells.groupby("element")["notebook"].unique()
    return {element: int(seconds.reindex(names).sum()) for element, names in makers.items()}


def describe_deviations(claims: pd.DataFrame) -> dict[str, Any]:
    """What was changed after a result: every change, and how each rule came about, up to today's verdict."""
    table = read_table("deviations")
    today = claims["verdict"].reindex(table["claim"]).set_axis(table.index)
    is_today = (table["claim"] != "") & (table["verdict_after"] == "")
    table["verdict_after"] = table["verdict_after"].mask(is_today, today)
    return {
        "deviations": table,
        "chains": {rule: _chain(part) for rule, part in table.groupby("rule", sort=False)},
        "changed_claims": table.loc[table["claim"] != "", "claim"].nunique(),
    }


def _chain(changes: pd.DataFrame) -> str:
    """Write how a rule came about: each form of it with its verdict."""
    first = changes.iloc[0]
    steps = [(first["before"], first["verdict_before"])]
    steps += zip(changes["after"], changes["verdict_after"], strict=True)
    return " → ".join(form + (f": *{verdict}*" if verdict else "") for form, verdict in steps)


def describe(verdicts: pd.DataFrame, claims: pd.DataFrame) -> dict[str, Any]:
    """Everything that a template may name: verdicts, claims, the paper's tables, and the notebooks' facts, `f`."""
    cells = verdicts.assign(shown=verdicts["grade"].replace("consistent", "agrees"))
    counts = Counter(cells["grade"])
    described = {
        "f": dict(ChainMap(*(each["facts"] for each in load_outcomes().values()))),
        "cells": cells.to_dict("records"),
        "differing": cells[cells["agreement"] == "differs"].groupby("why", sort=False),
        "cell": cells.to_dict("index"),
        "by_element": count_by(cells, "element"),
        "by_source": count_by(cells, "source"),
        "seconds": measured_seconds(cells),
        "claims": claims,
        "strong": counts["agrees"],
        "weak": counts["agrees weakly"],
        "consistent": counts["consistent"],
        "verdicts": VERDICTS,
    }
    if "errata" in SETTINGS:
        described["errata"] = read_table("errata")
    if "deviations" in SETTINGS:
        described |= describe_deviations(claims)
    return described


# ---------------------------------------------------------------------------------------------------------- writing


def load_template() -> jinja2.Template:
    """Load the report's template, which refuses to write what is not there."""
    pages = jinja2.Environment(
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        finalize=_refuse_absent,
    )
    pages.filters.update(typeset=typeset, span=span)

    def parse(text: str) -> jinja2.Template:
        template = pages.from_string(text)
        if "status" not in template.blocks:
            raise ValueError("the README's block, status, is gone")
        return template

    return read_committed(TEMPLATE, parse)


def _refuse_absent(value: object) -> object:
    """Refuse a value that says that there is none."""
    if ABSENT.search(str(value)):
        raise UserError(f"the report would say {str(value)!r}: a number is missing; run make all")
    return value


def render(described: dict[str, Any]) -> tuple[str, str]:
    """Fill in the template: the report, and its first section as the README has it; UserError where a number lacks."""
    template = load_template()
    try:
        context = template.new_context(described)
        page = "".join(template.root_render_func(context))
        status = "".join(template.blocks["status"](context))
    except jinja2.UndefinedError as error:
        raise UserError(f"the report lacks a number: {error}; run make all") from error
    return page, status.strip().replace("](../", "](")  # for a README lies one folder higher


def provenance() -> dict[str, Any]:
    """Versions of Python and of the packages that compute; SHA-256 of the public data by name."""
    versions = {package: version(package) for package in SETTINGS.get("versions", ())}
    python = "{}.{}".format(*sys.version_info)
    return {
        "versions": {"python": python} | versions,
        "authors_files": find_hook("checksums", dict)(),
    }


def make_report() -> dict[Path, bytes]:
    """Make the verdicts, the claims, `report.md` and `provenance.json` of the results.

    The report's first section goes into a README, too, between the marks of the status.

    Returns
    -------
    dict of Path to bytes
        What is to be written, the report first.

    Raises
    ------
    UserError
        Something is missing that the report is made from.
    """
    verdicts, claims = judging.verdicts(), judging.claims()
    try:
        described = describe(verdicts, claims)
    except (ValueError, LookupError) as error:
        why = f"{type(error).__name__}: {error}; is a table damaged? git checkout brings it back"
        raise UserError(f"{RESULTS}: the report cannot be made from it ({why})") from error
    page, status = render(described)
    text, count = STATUS.subn(lambda _: f"{status}\n", read_committed(README, str))
    if count != 1:
        raise UserError(
            f"{README}: not one pair of marks of the status; git checkout brings it back"
        )
    weak = (verdicts["grade"] == "agrees weakly").map({True: "yes", False: ""})
    return {
        RESULTS / "report.md": page.encode(),
        RESULTS / "verdicts.csv": as_csv(verdicts.assign(weak=weak).reset_index()[OF_CELLS]),
        RESULTS / "claims.csv": as_csv(claims.reset_index()[OF_CLAIMS]),
        RESULTS / "provenance.json": as_json(provenance()),
        README: text.encode(),
    }


def refuse_stale(made: dict[Path, bytes]) -> None:
    """Refuse a report, a table of its or a README that says other than the results; versions may be others."""
    for file, content in made.items():
        is_same = file.is_file() and file.read_bytes() == content
        if not is_same and not (file.name == "provenance.json" and file.is_file()):
            raise UserError(f"{file}: it says other than the results; make all makes it")


def list_verdicts(verdicts: pd.DataFrame, claims: pd.DataFrame) -> str:
    """Every printed number and every claim, as `make check` prints them, in groups: first what differs."""
    cells = verdicts.rename(columns={"agreement": "verdict"})
    columns = ["id", "printed", "ours", "interval", "unit", "source", "reason"]
    groups = []
    for table, what, shown in (
        (cells, "printed numbers", columns),
        (claims, "claims", ["id", "measured"]),
    ):
        for verdict in ("differs", "not tested", "agrees", "does not hold", "undecided", "holds"):
            chosen = table[table["verdict"] == verdict].reset_index()[shown]
            title = f"{len(chosen)} of {len(table)} {what}: {verdict}"
            groups += [f"{title}\n{_align(chosen)}"] if len(chosen) else []
    return "\n\n".join(groups)


def _align(table: pd.DataFrame) -> str:
    """A table's texts in columns."""
    texts = table.astype(str).apply(lambda column: column.str.ljust(column.str.len().max()))
    return "\n".join(texts.agg("  ".join, axis=1).str.rstrip())


def find_surprises(verdicts: pd.DataFrame) -> list[str]:
    """Find the numbers that differ and are no known difference of the table of cells."""
    is_unknown = verdicts["known_difference"] == ""
    return [*verdicts.index[(verdicts["agreement"] == "differs") & is_unknown]]
