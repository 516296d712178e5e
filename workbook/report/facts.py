"""What texts name in braces: counts of verdicts, and facts that notebooks export; the findings."""

import re
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd

from replication import published
from workbook import judging
from workbook.outcomes import load_outcomes
from workbook.report import TEMPLATES, squeeze
from workbook.report.cells import ERRATUM_KINDS, corrected_cells, minus

RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
WORDS = ("none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
POWER = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)e([+-]?\d+)\b")


def collect_facts(results: Path, verdicts: pd.DataFrame) -> dict[str, str]:
    """Every fact that a text may name, with powers of ten as they are written by hand."""
    found: dict[str, object] = {
        **count_verdicts(verdicts, judging.decided_claims(results)),
        **describe_table2(verdicts),
    }
    for outcome in load_outcomes(results).values():
        found |= outcome["facts"]
    return {name: typeset_powers(fact) for name, fact in found.items()}


def count_verdicts(verdicts: pd.DataFrame, claims: pd.DataFrame) -> dict[str, int]:
    """Count printed numbers, claims and errata by what is said of them.

    Of printed numbers "differs" counts all, "recomputed_differs" those whose number of ours has that source,
    "table2_differs" those of an element, "table2_sd_differs" those of its column; in place of "differs" also "agrees",
    "weak" (those of "agrees" whose resolution is low) and "not_tested". "claims_undecided" counts claims,
    "claims_changed" those whose criterion was changed, "claims_answers_changed" those of them whose answer is another
    one now, and "errata_paper" errata by their kind.
    """
    decided = verdicts.join(published.cells()[["element", "column"]], on="id")
    decided["weak"] = find_weak(decided)
    element = decided["element"].map(squeeze)
    source = decided["source"].str.replace("'", "").str.replace(r"\W", "_", regex=True)
    groups = {"": decided}
    for key in (source, element, element + "_" + decided["column"]):
        groups |= {f"{name}_": part for name, part in decided.groupby(key)}
    known, errata = published.table("claims"), published.table("errata")
    counts = {"printed": len(decided), "claims": len(known)}
    for name, part in groups.items():
        for word in judging.AGREEMENTS:
            counts[name + word.replace(" ", "_")] = (part["agreement"] == word).sum()
        counts[f"{name}weak"] = part["weak"].sum()
    earlier = claims["id"].map(known["earlier_answer"])
    first = earlier.where(earlier != "", claims["verdict"])
    counts["claims_answers_changed"] = (first != claims["verdict"]).sum()
    for verdict in judging.CLAIM_VERDICTS.values():
        name = verdict.replace(" ", "_")
        counts[f"claims_{name}"] = (claims["verdict"] == verdict).sum()
        counts[f"claims_first_{name}"] = (first == verdict).sum()
    for kind, words in (("claims", known["criterion_was"]), ("errata", errata["kind"])):
        counts |= {f"{kind}_{word}": number for word, number in words.value_counts().items()}
    return counts


def find_weak(verdicts: pd.DataFrame) -> pd.Series:
    """Whether each printed number's agreement is weak."""
    weak = [*map(judging.is_weak, verdicts["id"], verdicts["resolution"])]
    return (verdicts["agreement"] == "agrees") & pd.Series(weak, verdicts.index, dtype=bool)


def describe_table2(verdicts: pd.DataFrame) -> dict[str, object]:
    """How the means and SDs of Table 2's ten rows with backlash agree, and how wide our intervals are."""
    found: dict[str, object] = {}
    for of in ("mean", "sd"):
        rows = verdicts[verdicts["id"].str.fullmatch(rf"table2\.row(0\d|10)\.{of}")]
        numbers = rows["id"].str[10:12].astype(int)
        wide = numbers.isin((1, 10))
        agree = rows["agreement"] == "agrees"
        found |= {f"{of}s": WORDS[len(rows)], f"{of}s_agree": WORDS[agree.sum()]}
        found[f"{of}s_differing"] = list_differing(rows[rows["agreement"] == "differs"])
        seen_from = rows["resolution"].to_numpy(float)
        if of == "mean":
            found["mean_half_width"] = span(100 * seen_from[~wide], ".1f")
            found["mean_half_width_ends"] = span(100 * seen_from[wide], ".1f")
        else:
            found["sds_weak"] = WORDS[find_weak(rows).sum()]
            found["sd_factor"] = span(seen_from[agree], ".2g")
    return found


def count_numbers(verdicts: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Count the printed numbers by agreement: by element, with a last row of all, and by source."""
    by_element = judging.count_by(verdicts, "element")
    by_element.loc["all"] = by_element.sum()
    return by_element, judging.count_by(verdicts, "source")


def list_differing(rows: pd.DataFrame) -> str:
    """Name rows of Table 2 that differ, with the printed number and our interval; "none" where there is none."""
    named = [
        f"row {int(row.id[10:12])} (printed {row.printed}, ours {row.low:.2g} to {row.high:.2g})"
        for row in rows.itertuples()
    ]
    return " and ".join(named) or "none"


def span(numbers: np.ndarray, how: str) -> str:
    """Write the smallest and the largest of some numbers: "2.5 to 4.4"; the one where they look alike."""
    finite = numbers[np.isfinite(numbers)]
    if not finite.size:
        return ""
    low, high = (format(end, how) for end in (finite.min(), finite.max()))
    return low if low == high else f"{low} to {high}"


def typeset_powers(text: object) -> str:
    """Write powers of ten in a text as 5.9·10⁻⁶ or 10⁵, not as 5.9e-06 or 1e5, and signs as minus signs."""
    return minus(re.sub(r"(?<![\d.])1·10", "10", POWER.sub(_raise, str(text))))


def _raise(found: re.Match) -> str:
    return f"{found[1]}·10{str(int(found[2])).translate(RAISED)}"


TEMPLATES.filters["powers"] = typeset_powers


def fill(text: str, facts: dict[str, str]) -> str:
    """Put the facts' numbers into a text; empty where one of them is not there."""
    with suppress(KeyError):
        return text.format_map(facts)
    return ""


def fill_in_findings(facts: dict[str, str]) -> list[dict]:
    """The findings whose numbers are there: `kind`, `text`, label and address of each proof."""
    return [
        {
            "kind": row["kind"],
            "text": text,
            "proofs": [proof.strip().split("|") for proof in row["proof"].split(";")],
        }
        for row in published.table("findings").to_dict("records")
        if (text := fill(row["text"], facts))
    ]


def list_errata(facts: dict[str, str]) -> pd.DataFrame:
    """The errata with what we computed, and the ids of the numbers that each corrects."""
    errata = published.table("errata")
    return errata.assign(
        kind=[ERRATUM_KINDS[kind] for kind in errata["kind"]],
        computed=[fill(text, facts) for text in errata["computed"]],
        ids=pd.Series(corrected_cells()),
    ).reset_index()


def list_rules(facts: dict[str, str]) -> list[dict]:
    """The rules in the order in which they were fixed, with what each said."""
    trail = published.table("trail")
    return trail.assign(counts=[fill(text, facts) for text in trail["counts"]]).to_dict("records")
