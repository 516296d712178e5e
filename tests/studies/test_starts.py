"""Why a drawn start fails: what the kept table says, and what would refute it."""

import numpy as np
import pandas as pd
import pytest

from replication import published
from replication.files import ROOT
from replication.table2 import NOTEBOOK, RPM_600, WHOLE
from studies import starts
from workbook.outcomes import as_fact, load_outcomes

THEORETICAL = published.column("Table 2", "theoretical")[:10]
# Best minima, means and fits in the best minimum [%], and the share of these.
DRAWN = starts.AUTHORS, "per row", starts.SINGLE
OWN = starts.OWN, "per row", starts.SINGLE
RESTARTED = starts.OWN, "per row", starts.RESTARTS
AS_FOUND = {
    (starts.AUTHORS, WHOLE, starts.SINGLE): (-4, -5, -4, 0.8),
    DRAWN: (-4, -12, -4, 0.2),
    OWN: (-4, -13, -4, 0.2),
    RESTARTED: (-4, -8, -4, 0.5),
}


def make_rows(found):
    """The kept table of three tables of each search, all rows of a table off alike."""
    parts = []
    for (noise, start, search), (best, mean, in_best, share) in found.items():
        for settings in (NOTEBOOK, RPM_600) if noise == starts.AUTHORS else (RPM_600,):
            for table in (1, 2, 3):
                off = np.array([best, mean + table - 2, in_best])[:, None]
                columns = ["best_A_rps", "mean_A_rps", "mean_A_in_best_rps"]
                rows = pd.DataFrame(((1 + off / 100) * THEORETICAL).T, columns=columns)
                key = {"noise": noise, "settings": settings.name, "start": start, "search": search}
                parts.append(rows.assign(row=range(1, 11), table=table, best_share=share, **key))
    return pd.concat(parts, ignore_index=True)


def test_what_the_report_says_is_what_the_kept_table_says():
    rows = pd.read_csv(ROOT / "results" / "table2_starts.csv")
    facts = load_outcomes()["13_settings_of_table2"]["facts"]
    described = starts.describe(starts.summarise(rows))
    assert as_fact(described).items() <= facts["why_start"].items()
    assert starts.write_answer(described) == facts["why_start_words"]


CASES = {
    "as found": ({}, True),
    "the start moves the best minimum": ({DRAWN: (-7, -12, -7, 0.2)}, False),
    "the best minimum itself is missed by its fits": ({OWN: (-4, -13, -9, 0.2)}, False),
    "restarts leave most of the distance": ({RESTARTED: (-4, -9, -4, 0.5)}, None),
}


@pytest.mark.parametrize(("changed", "verdict"), CASES.values(), ids=CASES)
def test_each_criterion_can_refute_the_sentence(changed, verdict):
    summary = starts.summarise(make_rows(AS_FOUND | changed))
    assert (summary["highest_percent"] - summary["lowest_percent"]).tolist() == pytest.approx(
        [2] * 6
    )
    numbers = starts.describe(summary)
    assert numbers["search_misses"] is verdict
    says = {
        True: "So it is the search that fails, and not the start.",
        False: "So the search alone does not explain it.",
        None: "Whether the search or the start fails is undecided.",
    }[verdict]
    assert says in starts.write_answer(numbers)


def test_all_searches_on_a_row_share_noise_and_start_and_no_two_rows_do():
    record, first, seeds = starts.draw_row(starts.OWN, 1, "per row", 1)
    again, _, same = starts.draw_row(starts.OWN, 1, "per row", 1)
    whole, at_first, _ = starts.draw_row(starts.OWN, 1, WHOLE, 1)
    assert np.array_equal(record.v, again.v)
    assert np.array_equal(seeds, same)
    assert at_first == 0
    assert np.array_equal(whole.v[first:], record.v)
    other, *_ = starts.draw_row(starts.OWN, 2, WHOLE, 1)
    assert not np.array_equal(whole.v, other.v)
    assert len(set(seeds.ravel())) == seeds.size
