"""A claim's verdict moves with the number that decides it, and its words have the numbers that were measured."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from replication import published
from replication.files import ROOT
from replication.joint import identified_joint
from replication.records import Recording
from studies import claims, optimizers
from studies.multiverse import measure_random_start
from studies.realisations import read_realisations
from workbook.judging import CLAIM_VERDICTS, decide, decide_all

RESULTS = ROOT / "results"
KEPT = read_realisations()
COMMITTED = pd.read_csv(RESULTS / "claims.csv", index_col="id")


def verdicts(measured):
    return {claim: holds for claim, (holds, _) in decide_all(claims.write_all(measured)).items()}


# ---------------------------------------------------------------------------------------------- the words


def check_as_committed(measured):
    """Compare each verdict, and each number that a reader sees."""
    for claim, (holds, words) in decide_all(claims.write_all(measured)).items():
        assert (CLAIM_VERDICTS[holds], words) == tuple(
            COMMITTED.loc[claim, ["verdict", "measured"]]
        )


def test_verdicts_and_words_of_what_is_kept_are_the_committed_ones():
    """Of the claims that need neither the authors' records nor a simulation."""
    runs = optimizers.success_table(pd.read_csv(RESULTS / "optimizers.csv"))
    measured = {
        **claims.measure_dead_zone(identified_joint()),
        **claims.measure_equation_10(),
        **claims.measure_table2(KEPT),
        **claims.measure_public_files(),
        "random_start": measure_random_start(pd.read_csv(RESULTS / "table2_multiverse.csv")),
        "turns_reduce_noise": claims.measure_turns(pd.read_csv(RESULTS / "noise_by_turns.csv")),
        "cma_beats_swarms": claims.measure_swarms(optimizers.against_swarms(runs)),
        "classical_cannot": claims.measure_classical(runs, "classical"),
        "classical_prepared": claims.measure_classical(runs, "prepared"),
        "little_tuning": claims.measure_tuning(runs),
    }
    check_as_committed(measured)


RECORDS = pd.DataFrame(
    {
        "peak_rps": [0.1, 0.3, 0.45],
        "rms_rps": [0.05, 0.07, 0.11],
        "alternates": [True, False, True],
        "mismatch": [0.031, 0.047, 0.022],
        "rms_spread": [0.011, 0.023, 0.002],
        "rms_spread_whole": [0.07, 0.012, 0.041],
    }
)
AMPLITUDES = 0.002 * np.arange(1, 101)  # the 90th and the 99th hold the percentile
STEPPING = pd.DataFrame(
    {
        "model": ["modified", "stepping"] * 3,
        "delta_rad": [1.0, 1.0, 2.0, 2.0, 3.0, 3.0],
        "step_s": 1e-4,
        "error": [0.02, 0.03, -0.04, -0.05, 0.5, np.nan],
    }
)
# What is measured of made tables, what is compared of it and how it is said, worked out by hand.
SAID = {
    "two_impacts": (
        lambda: claims.measure_disturbance(RECORDS)["two_impacts"],
        2 / 3,
        "in 2 of 3 records the largest excursion changes its sign from every settled half turn to the next",
    ),
    "half_turn": (
        lambda: claims.measure_disturbance(RECORDS)["half_turn"],
        0.047,
        "inverted and half a turn later a record differs from itself by 2.2 to 4.7 % of its SD",
    ),
    "amplitude_grows": (
        lambda: claims.measure_disturbance(RECORDS)["amplitude_grows"],
        (0.02, 0.15),
        "smallest increase from level to level [rps]: peak of the samples 0.150, RMS 0.020, printed A 0.075",
    ),
    "same_amplitude": (
        lambda: claims.measure_disturbance(RECORDS)["same_amplitude"],
        0.023,
        "settled half turns differ by up to 2.3 % in RMS, with the first turn by up to 7.0 %",
    ),
    "uniform_noise": (
        lambda: claims.measure_uniform_noise(
            pd.DataFrame(
                {
                    "p_uniform": [0.03, 0.4],
                    "p_mean": [0.5, 0.2],
                    "p_lag_one": [0.6, 0.011],
                    "p_normal": [1e-9, 2e-7],
                }
            )
        ),
        0.066,
        "smallest p of 2 records times 6: uniform 0.18, mean 1, lag one 0.066; normal noise: at most 2e-07 uncorrected",
    ),
    "no_backlash": (
        lambda: claims.measure_no_backlash(AMPLITUDES, 0.25),
        (0.72, 0.8),
        "95th percentile of |A| over the smallest mean: 0.76 (95 % interval 0.72 to 0.80); it is below 0.25 in 31 of "
        "100 noise records; mean |A| 0.101, largest 0.200 rps",
    ),
    "impacts_at_phase_start": (
        lambda: claims.measure_impacts(pd.DataFrame({"share_passed": [0.12, 0.23, 0.07]})),
        0.23,
        "7 to 23 % of the phase has passed at the impact",
    ),
    "friction_disregarded": (
        lambda: claims.measure_friction(
            pd.DataFrame({"friction": [0, 0.02, 0.05], "change_percent": [0, -1.4, 17.2]})
        ),
        (1.4, 17.2),
        "on simulated logs frictions of 2 to 5 % of gravity change A by 1.4 to 17 %; the friction of the test's joint "
        "is not published",
    ),
    "depends_on_joint": (
        lambda: {"percent": 16.4},
        16.4,
        "a stiffness a fifth lower changes the settled peak by 16 %",
    ),
    "bits_suffice": (
        lambda: claims.measure_bits(
            pd.DataFrame(
                {"bits": [14, 14, 16, 19, 19], "change_rps": [3e-4, 2e-3, 4e-4, 1e-4, 3e-4]}
            ),
            19,
        ),
        3e-4,
        "19 bits change A by up to 0.0003 rps; the fewest tried that suffice: 16",
    ),
    "discontinuities_destabilise": (
        lambda: claims.measure_discontinuities(STEPPING),
        (0.05, np.inf),
        "largest error of the settled peak: modified 50 %, stepping diverges; stability was not measured",
    ),
}


@pytest.mark.parametrize("claim", SAID)
def test_what_is_measured_of_a_made_table_is_what_is_compared_and_said(claim):
    measure, compared, words = SAID[claim]
    numbers, written = claims.write_all({claim: measure()})[claim]
    assert written == words
    assert numbers == pytest.approx([*np.ravel(compared)])


def test_every_claim_that_can_be_measured_has_words_and_each_of_its_numbers_is_said_or_compared():
    table = published.table("claims")
    measured = {*table.index[table["untested"] == ""]} - {"full_robot", "static_reference"}
    assert {*claims.CLAIMS} == measured
    assert {*table["bears_on"]} == {"physics", "method", "wording", "access to data"}


# ---------------------------------------------------------------------------------------------- what is measured


def ring(delta, sign=-1.0, growth=1.0):
    """A made record of twelve turns: one half turn, repeated with a sign, and a little larger each time."""
    t = np.arange(100) * 0.002
    half = delta * 1e3 * np.exp(-10 * t) * np.sin(150 * t)
    v = 100 + np.concatenate([sign**k * growth**k * half for k in range(24)])
    return Recording(0.002 * np.arange(v.size), v, 100.0, 0.4, "made")


def test_a_made_record_has_the_peak_the_rms_and_the_spread_that_it_was_made_with():
    record = ring(5e-4, growth=1.01)
    row = claims.measure_records({5e-4: record}).iloc[0]
    half = record.v[:100] - 100
    settled = np.outer(1.01 ** np.arange(2, 24), half)
    assert row["delta_rad"] == 5e-4
    assert row["peak_rps"] == pytest.approx(max(half.max() * 1.01**22, -half.min() * 1.01**23))
    assert row["rms_rps"] == pytest.approx(np.linalg.norm(settled) / np.sqrt(settled.size))
    # A half turn and its next one, inverted: a hundredth of it is left.
    left = 0.01 * settled[:-1]
    signed = settled * (-1.0) ** np.arange(2, 24)[:, None]
    assert row["mismatch"] == pytest.approx(np.sqrt((left**2).mean()) / signed.std())
    assert row["rms_spread"] == pytest.approx(1.01**21 - 1)
    assert row["rms_spread_whole"] == pytest.approx(1.01**23 - 1)
    assert row["alternates"]
    assert not claims.measure_records({5e-4: ring(5e-4, sign=1.0)})["alternates"].any()


def test_records_of_the_authors_hold_what_the_text_says_of_them(authors_data):
    from replication.records import CLEAN_LEVELS, load_clean_records

    records = claims.measure_records(load_clean_records(CLEAN_LEVELS))
    check_as_committed(claims.measure_disturbance(records))


# ---------------------------------------------------------------------------------------------- verdicts


def test_public_files_of_a_bench_would_be_counted(monkeypatch):
    named = {"Bench/log1.csv": "", "a.xlsx": ""}
    monkeypatch.setattr(claims, "authors_checksums", lambda: named)
    assert claims.measure_public_files()["code_and_data_public"] == {"files": 2, "logs": 1}


def measure_phases(passed):
    return claims.measure_impacts(pd.DataFrame({"share_passed": [0.1, passed]}))


def measure_turns(ratio):
    rows = [(9e-4, turns, k, error) for turns, error in ((1, 1.0), (12, ratio)) for k in range(160)]
    columns = ["delta_rad", "turns", "noise", "error_rps"]
    return claims.measure_turns(pd.DataFrame(rows, columns=columns))


@pytest.mark.parametrize(
    ("claim", "numbers", "holds"),
    [
        ("no_backlash", claims.measure_no_backlash(np.full(10, 0.01), 0.26), None),  # too few
        ("impacts_at_phase_start", measure_phases(-0.1), False),  # before its phase
        ("impacts_at_phase_start", measure_phases(0.3), False),
        (
            "discontinuities_destabilise",
            claims.measure_discontinuities(STEPPING.assign(error=[0.04, 0.001] * 3)),
            False,  # the smooth torque errs more
        ),
        ("turns_reduce_noise", measure_turns(0.99), None),  # not surely
        ("turns_reduce_noise", measure_turns(2.0), False),
    ],
)
def test_a_claim_on_a_made_table_moves_with_its_numbers(claim, numbers, holds):
    assert verdicts({claim: numbers})[claim] is holds


def test_an_interval_is_that_of_f_and_one_without_an_end_says_so():
    factor = np.sqrt(stats.f.isf(0.025, 160, 160))
    measured = measure_turns(0.5)
    assert (measured["low"], measured["high"]) == pytest.approx((0.5 / factor, 0.5 * factor))
    of_ten = claims.measure_no_backlash(np.full(10, 0.01), 0.26)
    assert "to no end below 72 records);" in claims.write_words("no_backlash", of_ten)


@pytest.mark.parametrize(
    ("claim", "inside", "outside"),
    [
        ("no_backlash", (0.1, 0.2), (0.3, 0.4)),
        ("little_tuning", (0.6, 0.7), (0.1, 0.2)),
        ("cma_beats_swarms", (0.01, 0.9), (0.9, 0.01)),
        ("encoder_step", 1.2e-5, 2e-5),
    ],
)
def test_a_margin_lies_below_one_where_a_claim_holds_and_above_where_it_does_not(
    claim, inside, outside
):
    assert decide(claim, inside) is True
    assert decide(claim, outside) is False
    assert claims.margin(claim, inside)[1] <= 1 <= claims.margin(claim, outside)[0]
