"""The report: one template with the results' numbers filled in; and the list of `make check`."""

import html
import json
import math
import os
import re
import sys
from collections import ChainMap
from collections.abc import Iterable
from decimal import Decimal, InvalidOperation
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd

from replication import published, table2
from replication.files import KEPT_SHA256, UserError, as_csv, as_json, read_committed, write_files
from replication.records import AUTHORS_FILES, authors_checksums
from studies import multiverse, realisations
from workbook import judging
from workbook.outcomes import kept_table, load_outcomes, read_kept, read_made
from workbook.project import RESULTS, ROOT
from workbook.stamps import digest_code, new_record, sha256

TEMPLATE = Path(__file__).with_name("report.md.j2")
STATUS_MARKS = ("<!-- status: begin -->", "<!-- status: end -->")
STATUS = re.compile("|".join(STATUS_MARKS))
CONSISTENCY = "the paper's own numbers"
WEAKLY = "agrees weakly"
VERDICTS = ("agrees", WEAKLY, "differs", "not tested")
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
GREEK = re.compile(r"\b(alpha|delta|lambda|mu|omega|pi|sigma|tau)(?=\b|_)")
ABSENT = re.compile(r"\b(nan|None|inf)\b")
POWER = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)e([+-]?\d+)\b")

ERRATA = {
    "proved": "Proved: a test shows each",
    "imprecise": "Imprecise",
    "text": "Rest on the extracted text, whose formulas may be garbled: check the printed paper",
    "data": "The text against the public data: no errata, either may be right",
}

# ------------------------------------------------------------------------------------------------- numbers in words


def like_printed(value: float, printed: str) -> str:
    """Write our number with the digits of the printed one, or with more where that shows nothing."""
    if math.isnan(value):
        return ""
    try:
        digits = Decimal(printed.rstrip("%"))
    except InvalidOperation:
        return f"{value:.4g}"
    if "e" in printed.lower():
        return f"{value:.2e}"
    text = f"{value:.{max(0, -int(digits.as_tuple().exponent))}f}"
    return text if abs(float(text) - value) <= 0.02 * abs(value) else f"{value:.3g}"


def typeset(text: object) -> str:
    """Write powers of ten as 5.9·10⁻⁶ or 10⁵, Greek letters and a minus sign before a number as such."""
    text = html.unescape(GREEK.sub(r"&\1;", str(text))).replace("dtheta", "Δθ")
    raised = POWER.sub(lambda e: f"{e[1]}·10{str(int(e[2])).translate(RAISED)}", text)
    raised = re.sub(r"(?<![\d.])1·10", "10", raised)
    return re.sub(r"(?<![\w)\]])-(?=[\d.])", "−", raised)


def span(numbers: Any, form: str) -> str:
    """Write the smallest and the largest of some numbers: "2.5 to 4.4"; the one where they look alike."""
    low, high = (format(end, form) for end in (np.min(numbers), np.max(numbers)))
    return low if low == high else f"{low} to {high}"


def write_p(p: float, least: float = 0.0) -> str:
    """Write a p with two digits, or what it is below; 0.44, below 0.001, "at most 0.0031" if it can be no less."""
    bound = "at most " if p <= 1.001 * least else ""
    return "below 0.001" if p < 0.001 else f"{bound}{p:.2g}"


def write_rejections(tests: multiverse.Rejections) -> str:
    """Write how many tests reject: "none of 36 tests"."""
    if tests.tests == 0:
        return "none (too few tables) of 0 tests"
    number = {0: "none", tests.tests: "all"}.get(tests.rejected, tests.rejected)
    return f"{number} of {tests.tests} tests"


# ------------------------------------------------------------------------------------------------ what the text has


def describe_cells(verdicts: pd.DataFrame) -> pd.DataFrame:
    """Printed numbers with their verdicts, as a reader reads them: `name, printed, ours, interval, why` it differs."""
    about = published.cells()[["element", "row", "column", "known_difference"]]
    table = verdicts.join(about, on="id")
    table["name"] = [_name(*row) for row in table[["element", "row", "column"]].to_numpy()]
    table["why"] = table["known_difference"].replace("", "no explanation known")
    table["ours"] = [*map(like_printed, table["reproduced"], table["printed"])]
    table["interval"] = [_interval(row) for row in table.itertuples()]
    table["shown"] = table["agreement"].mask(table["weak"] == "yes", WEAKLY)
    return table


def _name(element: str, row: str, column: str) -> str:
    of_row = f"row {row}" if row.isdigit() else row
    return f"{element}, {of_row}" + ("" if column == "value" else f", {column.replace('_', ' ')}")


def _interval(row: Any) -> str:
    if row.agreement == "not tested" or math.isnan(row.reproduced):
        return ""
    if math.isinf(row.high):
        return f"at least {like_printed(row.low, row.printed)}"
    return " to ".join(like_printed(end, row.printed) for end in (row.low, row.high))


def count_by(cells: pd.DataFrame, key: str, order: Iterable[str]) -> pd.DataFrame:
    """Count printed numbers by agreement, and by "element" or "source", in an order that may end in "all"."""
    counts = pd.crosstab(cells[key], cells["shown"], margins=True, margins_name="all")
    return counts.reindex(index=[*order], columns=VERDICTS, fill_value=0)


def measured_seconds(cells: pd.DataFrame) -> dict[str, int]:
    """Run time of the notebooks that make an element's numbers [s], as `results/notebook_times.csv` has it."""
    seconds = read_kept("notebook_times").set_index("notebook")["seconds"]
    makers = cells[cells["notebook"] != ""].groupby("element")["notebook"].unique()
    return {element: int(seconds.loc[names].sum()) for element, names in makers.items()}


def describe_table2(cells: pd.DataFrame, column: str) -> dict[str, Any]:
    """How the ten means or SDs of Table 2 agree one by one, and how far their intervals reach."""
    rows = cells[cells["id"].str.fullmatch(rf"table2\.row(0\d|10)\.{column}")]
    return {
        "all": len(rows),
        "agree": (rows["agreement"] == "agrees").sum(),
        "differ": [*rows.loc[rows["agreement"] == "differs", "row"]],
        "down": 100 * (1 - rows["low"] / rows["reproduced"]),
        "up": 100 * (rows["high"] / rows["reproduced"] - 1),
        "factor": (rows["high"] / rows["low"])[rows["agreement"] == "agrees"],
    }


def describe_hardware() -> dict[str, Any]:
    """What the sensor says of public logs of real joints: how many it refuses, and why, the usual reason first."""
    logs = read_kept("hardware")
    reasons = logs.loc[logs["verdict"] == "cannot tell", "reason"].value_counts()
    return {"logs": len(logs), "refused": reasons.sum(), "reasons": [*reasons.items()]}


def describe_engine() -> dict[str, float]:
    """How far an independent physics engine is from our simulated joint, at its finest step."""
    twins = read_kept("engine").dropna(subset="nrmse")
    finest = twins.loc[twins["step_s"].idxmin()]
    return {"error_percent": 100 * finest["nrmse"], "step_us": 1e6 * finest["step_s"]}


def describe_claims(claims: pd.DataFrame) -> pd.DataFrame:
    """Claims as a reader reads them: the paper's words, and what we take them to say."""
    readings = claims["reading"].where(claims["reading"] == "", " (" + claims["reading"] + ")")
    return claims.assign(claim="“" + claims["quote"] + "”" + readings).set_index("id")


def describe_deviations(claims: pd.DataFrame) -> dict[str, Any]:
    """What was changed after a result: every change, and how each rule came about, up to today's verdict."""
    table = published.table("deviations")
    today = claims.set_index("id")["verdict"].reindex(table["claim"]).set_axis(table.index)
    is_last = (table["claim"] != "") & ~table["claim"].duplicated(keep="last")
    table["verdict_after"] = table["verdict_after"].mask(is_last, today)
    return {
        "deviations": table.to_dict("records"),
        "chains": {rule: _chain(part) for rule, part in table.groupby("rule", sort=False)},
        "changed_claims": table.loc[table["claim"] != "", "claim"].nunique(),
    }


def _chain(changes: pd.DataFrame) -> str:
    """Write how a rule came about: each form of it with its verdict."""
    first = changes.iloc[0]
    steps = [(first["before"], first["verdict_before"])]
    steps += zip(changes["after"], changes["verdict_after"], strict=True)
    return " → ".join(form + (f": *{verdict}*" if verdict else "") for form, verdict in steps)


def describe_theoretical(cells: pd.DataFrame) -> dict[str, float]:
    """How far our ten theoretical A of Table 2 lie off the printed ones [%], and t of their mean."""
    rows = cells[cells["id"].str.fullmatch(r"table2\.row(0\d|10)\.theoretical")]
    off = 100 * (rows["reproduced"] / rows["published"] - 1)
    return {"largest": off.abs().max(), "mean": off.mean(), "t": off.mean() / off.sem()}


def describe(verdicts: pd.DataFrame, claims: pd.DataFrame, results: Path) -> dict[str, Any]:
    """Everything that the template names: of verdicts, of claims, and of the facts in a folder of results."""
    cells = describe_cells(verdicts)
    agrees = cells["shown"] == "agrees"
    return {
        "f": dict(ChainMap(*(each["facts"] for each in load_outcomes(results).values()))),
        "cells": cells.to_dict("records"),
        "differing": cells[cells["agreement"] == "differs"].groupby("why", sort=False),
        "cell": cells.set_index("id").to_dict("index"),
        "by_element": count_by(cells, "element", [*cells["element"].unique(), "all"]),
        "seconds": measured_seconds(cells),
        "by_source": count_by(cells, "source", judging.SOURCES),
        "means": describe_table2(cells, "mean"),
        "sds": describe_table2(cells, "sd"),
        "evidence": multiverse.describe_multiverse(
            realisations.read_realisations(kept_table("table2_realisations")),
            read_made("table2_multiverse"),
        ),
        "hardware": describe_hardware(),
        "engine": describe_engine(),
        "claims": describe_claims(claims),
        "populations": [settings.population for settings in table2.SETTINGS],
        **describe_deviations(claims),
        "theoretical": describe_theoretical(cells),
        "strong": (agrees & (cells["source"] != CONSISTENCY)).sum(),
        "consistent": (agrees & (cells["source"] == CONSISTENCY)).sum(),
        "weak": (cells["shown"] == WEAKLY).sum(),
        "errata": published.table("errata").reset_index().groupby("kind"),
        "kinds_of_errata": ERRATA,
        "verdicts": VERDICTS,
        "sources": judging.SOURCES,
    }


# ---------------------------------------------------------------------------------------------------------- writing


def load_template() -> jinja2.Template:
    """Load the report's template, which refuses to write what is not there."""
    return read_committed(TEMPLATE, _parse_template)


@cache
def _parse_template(text: str) -> jinja2.Template:
    pages = jinja2.Environment(
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        finalize=_refuse_absent,
    )
    pages.filters.update(typeset=typeset, span=span, p=write_p, rejections=write_rejections)
    template = pages.from_string(text)
    if "status" not in template.blocks:
        raise ValueError("the README's block, status, is gone")
    return template


def _refuse_absent(value: object) -> object:
    """Refuse a value that says that there is none."""
    if ABSENT.search(str(value)):
        raise UserError(f"the report would say {str(value)!r}: a number is missing; run make all")
    return value


def render(described: dict[str, Any]) -> tuple[str, str]:
    """Fill in the template: the report, and its first section as the README has it; UserError where a number lacks."""
    template = load_template()
    try:
        status = "".join(template.blocks["status"](template.new_context(described | {"up": ""})))
        return template.render(described, up="../"), status.strip()
    except jinja2.UndefinedError as error:
        raise UserError(f"the report lacks a number: {error}; run make all") from error


PACKAGES = ("joblib", "matplotlib", "numba", "numpy", "openpyxl", "pandas", "scipy")


def provenance() -> dict[str, Any]:
    """Versions of Python and of the packages that compute; SHA-256 of the authors' files."""
    registry = authors_checksums()
    python = ".".join(map(str, sys.version_info[:2]))
    return {
        "versions": {"python": python} | {package: version(package) for package in PACKAGES},
        "authors_files": {file: registry[file] for file in AUTHORS_FILES},
    }


def digest_tables(project: Path) -> dict[str, str]:
    """SHA-256, by name, of what the report is made from besides code: outcomes, kept tables and the template."""
    beside = project / "results" / KEPT_SHA256
    kept = read_committed(beside, lambda text: [*json.loads(text)])
    files = [*(project / "results" / "outcomes").glob("*.json"), beside, TEMPLATE]
    files += [project / "results" / name for name in kept]
    return {os.path.relpath(file, project): sha256(file) for file in files}


def write_report(results: Path = RESULTS, readme: Path = ROOT / "README.md") -> list[Path]:
    """Write the verdicts, the claims, `report.md` and `provenance.json` of a results folder, all or none.

    The report's first section goes into a README, too, between the marks of the status.

    Returns
    -------
    list of Path
        What was written, the report first.

    Raises
    ------
    UserError
        Something is missing that the report is made from.
    """
    code, tables = digest_code(results.parent), digest_tables(results.parent)
    verdicts, claims = judging.verdicts(results), judging.claims(results)
    try:
        described = describe(verdicts, claims, results)
    except (ValueError, LookupError) as error:
        why = f"{type(error).__name__}: {error}; is a table damaged? git checkout brings it back"
        raise UserError(f"{results}: the report cannot be made from it ({why})") from error
    page, status = render(described)
    text = read_committed(readme, str)
    if STATUS.findall(text) != list(STATUS_MARKS):  # the text between two pairs would go
        raise UserError(
            f"{readme}: not one pair of marks of the status; git checkout brings it back"
        )
    before, _, after = STATUS.split(text)
    text = f"{before}{STATUS_MARKS[0]}\n{status}\n{STATUS_MARKS[1]}{after}"
    made = {
        "results/report.md": page.encode(),
        "results/verdicts.csv": as_csv(verdicts),
        "results/claims.csv": as_csv(claims),
    }
    made["results/provenance.json"] = as_json(provenance() | new_record(code, tables, made))
    written = {results.parent / name: content for name, content in made.items()}
    written[readme] = text.encode()
    write_files(written)
    return [*written]


def list_verdicts(verdicts: pd.DataFrame, claims: pd.DataFrame) -> str:
    """Every printed number and every claim, as `make check` prints them, in groups: first what differs."""
    cells = describe_cells(verdicts).join(published.cells()["unit"], on="id")
    columns = ["id", "printed", "ours", "interval", "unit", "source", "reason"]
    groups = []
    for agreement in ("differs", "not tested", "agrees"):
        chosen = cells.loc[cells["agreement"] == agreement, columns]
        groups.append((f"{len(chosen)} of {len(cells)} printed numbers: {agreement}", chosen))
    for verdict in ("does not hold", "undecided", "holds"):
        chosen = claims.loc[claims["verdict"] == verdict, ["id", "measured"]]
        groups.append((f"{len(chosen)} of {len(claims)} claims: {verdict}", chosen))
    return "\n\n".join(f"{title}\n{_align(table)}" for title, table in groups)


def _align(table: pd.DataFrame) -> str:
    """A table's texts in columns, the last one as long as it is."""
    *first, last = (table[name].astype(str) for name in table)
    columns = [[f"{text:{column.str.len().max()}}" for text in column] for column in first]
    return "\n".join(map("  ".join, zip(*columns, last, strict=True)))


def find_surprises(verdicts: pd.DataFrame) -> list[str]:
    """Find the numbers that differ and are no known difference of `cells.csv`."""
    differs = verdicts.loc[verdicts["agreement"] == "differs", "id"]
    return [cell for cell in differs if not published.cells().loc[cell, "known_difference"]]
