import os
import subprocess
import sys
from dataclasses import replace
from itertools import starmap

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from replication import published, table2
from replication.files import FLOAT_FORMAT, ROOT
from replication.processors import pinned_environment
from replication.signature import rmse
from replication.table2 import SearchSettings
from studies.replay import protocols
from studies.replay.protocols import CANDIDATES, LEADER, LISTED, POOLED, REALISATIONS, ROWS

NOTEBOOK = "authors' notebook"
N = 40


def made_numbers(seed, factor=1.0, size=N):
    """Means that scatter about a multiple of the printed ones, and SDs of two humps; shape (2, 10, size)."""
    rng = np.random.default_rng(seed)
    printed = protocols.printed()[..., None]
    means = factor * printed[0] * np.exp(0.03 * rng.standard_normal((10, size)))
    sds = printed[1] * np.exp(
        rng.choice([0.0, 1.0], (10, size)) + 0.4 * rng.normal(size=(10, size))
    )
    return np.stack([means, sds])


def test_every_candidate_has_a_reason_and_one_of_them_leads():
    assert (LISTED["why"] != "").all()
    assert LISTED["realisations"].idxmax() == LEADER
    assert CANDIDATES[NOTEBOOK] == SearchSettings()
    assert CANDIDATES[LEADER].rpm
    assert {type(candidate.rpm) for candidate in CANDIDATES.values()} == {bool}


def test_a_table_that_the_candidate_printed_has_a_uniform_p():
    tables = [made_numbers(seed, size=N + 1) for seed in range(200)]
    found = [protocols.scores(table[..., :N], table[..., N]) for table in tables]
    for k in range(2):
        p = [protocols.exact_p(scores[k]) for scores in found]
        assert stats.kstest(p, "uniform").pvalue > 0.01


@pytest.mark.parametrize(("number", "factor"), [(0, 1.1), (0, 0.9), (1, 0.02), (1, 50.0)])
def test_a_table_with_other_means_or_sds_is_not_explained(number, factor):
    numbers = made_numbers(1)
    judged = np.median(numbers, axis=-1)
    right = protocols.compare(numbers, judged)
    judged[number] *= factor
    wrong = protocols.compare(numbers, judged)
    of, other = ("p_means", "p_sds")[:: 1 - 2 * number]
    assert min(right["p_means"], right["p_sds"]) > 0.05
    assert wrong[of] < 0.001
    assert wrong[other] == right[other]
    assert wrong["sds_inside" if number else "means_inside"] < 5


def test_a_bias_has_a_small_p_only_if_tables_drawn_row_by_row_do_not_have_it():
    means = made_numbers(1)[0]
    own = float(np.median(protocols.pooled_bias(means)))
    assert protocols.bias_p(means, own) > 0.5
    assert protocols.bias_p(means, own + 10) < 0.001
    assert protocols.bias_p(means, own - 10) < 0.001


def test_eight_settings_judge_together_with_as_many_realisations_each():
    study = pd.read_csv(REALISATIONS)
    chosen = protocols.pooled(study)
    assert len(POOLED) == 8
    assert (chosen.groupby(["protocol", "row"]).size() == N).all()
    assert set(chosen["protocol"]) == set(POOLED)
    assert LISTED.loc[POOLED, "start"].eq("whole").all()


def test_a_population_of_2000_and_drawn_starts_are_excluded_and_the_eight_are_not():
    judged = protocols.judge(pd.read_csv(REALISATIONS)).set_index("protocol")
    assert set(judged.index[judged["excluded"]]) == set(LISTED.index) - set(POOLED)
    assert (judged.loc[judged["start"] == "per record", "p_bias"] < 0.001).all()
    assert judged.loc["pooled", ["means_inside", "sds_inside"]].tolist() == [10, 8]


# ---------------------------------------------------------------------------------------------------------- the study


def quick(monkeypatch, **settings):
    """Candidates and rows that take no time."""
    candidate = SearchSettings(name="a", population=10, iterations=1, **settings)
    monkeypatch.setattr(protocols, "CANDIDATES", {"a": candidate})
    monkeypatch.setattr(protocols, "LISTED", LISTED.iloc[:1].set_axis(["a"]).assign(realisations=3))
    monkeypatch.setattr(protocols, "rows_of", lambda realisation: (protocols.LAST_ROW,))
    monkeypatch.setattr(
        protocols, "in_parallel", lambda function, calls, label: [*starmap(function, calls)]
    )
    return candidate


def test_an_interrupted_study_goes_on_and_gives_the_same(tmp_path, monkeypatch):
    quick(monkeypatch)
    monkeypatch.setattr(protocols, "KEPT", tmp_path)
    realise, made = protocols.realise, []

    def count_or_stop(protocol, row, realisation):
        if len(made) == 2:
            raise KeyboardInterrupt
        made.append(realisation)
        return realise(protocol, row, realisation)

    monkeypatch.setattr(protocols, "realise", count_or_stop)
    with pytest.raises(KeyboardInterrupt):
        protocols.realise_all()
    made.clear()
    again = protocols.realise_all()
    assert made == [3]
    assert again["realisation"].tolist() == [1, 2, 3]
    assert again.loc[0].to_dict() == realise(protocols.CANDIDATES["a"], protocols.LAST_ROW, 1)


def test_a_drawn_start_is_one_for_each_record(monkeypatch):
    starts = []
    monkeypatch.setattr(
        protocols, "from_sample", lambda record, start: starts.append(start) or record
    )
    drawn = quick(monkeypatch, start="per record")
    for realisation in range(1, 20):
        protocols.realise(drawn, protocols.LAST_ROW, realisation)
    protocols.realise(replace(drawn, start="whole"), protocols.LAST_ROW, 1)
    assert len(starts) == 19
    assert len(set(starts)) > 10
    assert set(starts) <= set(range(int(published.value("text.latest_start"))))


def test_every_realisation_has_its_own_noise_of_the_printed_amplitude():
    records = [protocols.noisy_record(protocols.LAST_ROW, R).v - 100 for R in (1, 2)]
    assert np.abs(records[0]).max() == pytest.approx(
        published.value("table2.row11.noise"), rel=0.01
    )
    assert abs(np.corrcoef(records)[0, 1]) < 0.1


def test_a_run_in_rpm_ends_in_rps(authors_data):
    record = protocols.noisy_record(5, 1)
    for name in (NOTEBOOK, LEADER):
        fit = table2.fit(record, CANDIDATES[name], 4)
        assert fit.amplitude_rps == pytest.approx(0.68, abs=0.04)
        again = rmse(record.t, record.v, fit.X, CANDIDATES[name].timing)
        assert fit.rmse == pytest.approx(again, rel=1e-9)


def test_every_candidate_has_its_realisations_of_every_row():
    study = pd.read_csv(REALISATIONS)
    counts = study[study["row"].isin(ROWS)].groupby("protocol", sort=False).size()
    assert counts.to_dict() == (len(ROWS) * LISTED["realisations"]).to_dict()
    last = study[study["row"] == protocols.LAST_ROW].groupby("protocol", sort=False).size()
    assert (
        last.to_dict() == LISTED["realisations"].clip(upper=protocols.REALISATIONS_EACH).to_dict()
    )


RUN_AGAIN = """
import sys
from studies.replay.protocols import CANDIDATES, realise
name, row, realisation = sys.argv[1:]
found = realise(CANDIDATES[name], int(row), int(realisation))
print(found["mean_A_rps"], found["sd_A_rps"])
"""


@pytest.mark.slow
@pytest.mark.parametrize("place", np.random.default_rng(1).random(3))
def test_a_realisation_drawn_from_the_committed_ones_comes_out_the_same_again(authors_data, place):
    study = pd.read_csv(REALISATIONS)
    kept = study.iloc[int(place * len(study))]
    which = kept[["protocol", "row", "realisation"]].astype(str)
    done = subprocess.run(
        [sys.executable, "-c", RUN_AGAIN, *which],
        env=os.environ | pinned_environment(),
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    again = [float(FLOAT_FORMAT % float(number)) for number in done.stdout.split()]
    assert again == kept[["mean_A_rps", "sd_A_rps"]].tolist()
