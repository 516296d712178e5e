"""Numbers that sentences of the report and the article hold (`facts.csv`), and the report's findings made of them."""

import re
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd

from replication import published
from replication.replay import AGREE_RPS  # noqa: F401  of the queries
from replication.statistics import LEVEL
from replication.table2 import AUTHORS_PROTOCOL, error_percent
from workbook import judging
from workbook.report import TEMPLATES

RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
POWER = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)e([+-]?\d+)\b")


def collect_facts(results: Path, verdicts: pd.DataFrame) -> dict[str, str]:
    """Every number and phrase that a sentence may hold, as text; those whose results are not there are left out.

    A row of `facts.csv` names a table, a query that chooses rows of it, an expression of their columns, the statistic
    that makes it one number ("count" counts the rows) and the number's format.
    """
    found = {"population": str(AUTHORS_PROTOCOL.population), "iterations": str(AUTHORS_PROTOCOL.iterations)}
    found["level"] = f"{100 * LEVEL:.0f}"
    if (results / "protocols.csv").exists():
        found["protocol_finding"] = describe_protocols(pd.read_csv(results / "protocols.csv").set_index("protocol"))
    for file in results.glob("*_bars.csv"):
        failed = pd.read_csv(file).query("not met").itertuples()
        said = [f"{bar.population}: {bar.figure} {bar.measured:.3g}, not {bar.bar}" for bar in failed]
        found[file.stem.replace("bars", "failed")] = typeset_powers("; ".join(said)).replace("_", " ")
    for name, facts in pd.read_csv(str(published.DATA / "facts.csv")).fillna("").groupby("table", sort=False):
        try:
            table = _table(str(name), results, verdicts)
        except FileNotFoundError:
            continue
        for fact in facts.to_dict("records"):
            chosen = table.query(fact["rows"]) if fact["rows"] else table
            if fact["statistic"] == "count":
                found[fact["name"]] = str(len(chosen))
            elif len(chosen):
                value = getattr(chosen.eval(fact["value"]), fact["statistic"])()
                if not pd.isna(value):
                    found[fact["name"]] = _write_number(value, fact["format"])
    return found


def _table(name: str, results: Path, verdicts: pd.DataFrame) -> pd.DataFrame:
    """A table of the results or of the package's data, or one of those that are put together here."""
    match name:
        case "decided":
            return judging.deciding(verdicts)
        case "claims":
            return published.claims().join(judging.decided_claims(results).set_index("id")["verdict"])
        case "regions":
            return _regions(verdicts)
        case "best_basins":
            return _best_basins(pd.read_csv(results / "table2.csv"))
        case "stored_generations":
            keys = ["run", "generation"]
            return published.authors_notebook_generations().merge(pd.read_csv(results / "replay.csv"), "left", keys)
    file = results / f"{name}.csv"
    return pd.read_csv(str(file if file.exists() else published.DATA / file.name))


def _regions(verdicts: pd.DataFrame) -> pd.DataFrame:
    """The deciding verdicts on the means and SDs of Table 2's rows with backlash, and the theoretical A of the rows."""
    printed = published.cells("Table 2").query("row != '11'")
    theoretical = printed[printed["column"] == "theoretical"].set_index("row")["value"]
    regions = printed.loc[printed["column"].isin(["mean", "sd"]), ["row", "column"]]
    judged = regions.join(judging.deciding(verdicts).set_index("id")).assign(missed_by_chance=1 - LEVEL)
    return judged.join(theoretical.rename("theoretical"), on="row")


def _best_basins(table2: pd.DataFrame) -> pd.DataFrame:
    """How far the best basin's A is off the printed means of Table 2, by source and realisation."""
    table = table2[table2["theoretical_A_rps"] > 0]
    errors = error_percent(table, "best_A_rps").groupby([table["source"], table["realisation"]])
    worst, rms = errors.agg(lambda part: part.abs().max()), errors.agg(lambda part: np.sqrt((part**2).mean()))
    return pd.DataFrame({"worst_percent": worst, "rms_percent": rms}).reset_index()


def _write_number(value: float, form: str) -> str:
    """Write a number in a format of `str`, as "one digit" (7000) or "power 2" (5.93·10⁻⁶), or one of two phrases."""
    if "|" in form:
        return form.split("|")[0 if value else 1]
    if form == "one digit":
        return f"{float(f'{value:.1g}'):.0f}"
    if not form.startswith("power"):
        return f"{value:{form}}"
    return typeset_powers(f"{value:.{form.split()[1]}e}")


def typeset_powers(text: object) -> str:
    """Write the powers of ten in a text as 5.9·10⁻⁶ or 10⁵, not as 5.9e-06 or 1e5."""
    raised = POWER.sub(lambda found: f"{found[1]}·10{str(int(found[2])).translate(RAISED)}", str(text))
    return re.sub(r"(?<![\d.])1·10", "10", raised)


TEMPLATES.filters["powers"] = typeset_powers


def describe_protocols(judged: pd.DataFrame) -> str:
    """Say in one sentence which candidate protocols are compatible with Table 2."""
    explaining = [f"{name} (p = {p:.2g})" for name, p in judged.loc[judged["explains"], "p"].items()]
    names = f": {', '.join(explaining)}" if explaining else ""
    names += "; the table cannot tell them apart" if len(explaining) > 1 else ""
    failing = judged.loc[~judged["explains"], "p"].nlargest(1)
    names += "".join(f". The next, {name}, fails with p = {p:.2g}" for name, p in failing.items())
    said = f"{len(explaining) or 'None'} of {len(judged)} candidate protocols are compatible with Table 2{names}."
    return f"{said} Other seeds move such a p; no p is corrected for the number of candidates."


def fill(text: str, facts: dict[str, str]) -> str:
    """Put the facts' numbers into a text; empty where one of them is not there."""
    with suppress(KeyError):
        return text.format_map(facts)
    return ""


def fill_in_findings(facts: dict[str, str]) -> list[dict]:
    """The findings whose numbers are there: `kind` ("holds", "open" ...), `text`, label and address of each proof."""
    found = []
    for row in published.findings().to_dict("records"):
        proofs = [proof.strip().split("|") for proof in row["proof"].split(";")]
        if text := fill(row["text"], facts):
            found.append({"kind": row["kind"], "text": text, "proofs": proofs})
    return found
