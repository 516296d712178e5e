import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash.calibration import Calibration, default_calibration, fit_calibration
from backlash.fitting.readings import METHODS, Reading, read
from backlash.refusals import Refusal
from replication import published
from replication.characteristic import equation_10
from replication.records import add_noise, from_sample, level_delta_rad
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings
from replication.records import load_noisy
from studies.calibrations import compute_default

LEVELS_RAD = [4e-4, 6e-4, 8e-4, 10e-4, 12e-4, 14e-4, 16e-4, 18e-4]


@pytest.fixture(scope="module")
def records():
    return simulate_recordings(identified_joint(), LEVELS_RAD)


def reading(value, half_width):
    return Reading(value, (value - half_width, value + half_width), 1.0, (0.9, 1.1))


@pytest.mark.parametrize("method", ["energy", "waveform", "impact"])
def test_a_calibration_reads_its_own_logs_back_and_brackets_one_that_it_never_saw(records, method):
    calibration = fit_calibration(records, LEVELS_RAD, method)
    for record, delta in zip(records, LEVELS_RAD, strict=True):
        own = calibration.backlash(read(record, method, calibration.bank))
        assert own.delta_rad == pytest.approx(delta, abs=max(2 * calibration.uncertainty_rad, 1e-9))
    new = simulate_recordings(identified_joint(), [11e-4])[0]
    answer = calibration.backlash(read(new, method, calibration.bank))
    assert answer.interval_rad[0] <= 11e-4 <= answer.interval_rad[1]
    assert not answer.extrapolated
    for outside in simulate_recordings(identified_joint(), [3e-4, 20e-4]):
        assert calibration.backlash(read(outside, method, calibration.bank)).extrapolated


@pytest.mark.parametrize("method", METHODS)
def test_a_calibration_written_and_read_back_gives_the_same_answers(method):
    calibration = default_calibration(method)
    again = Calibration.from_json(calibration.to_json(), "file")
    assert again.to_json() == calibration.to_json()
    value = 1e-3 if method == "waveform" else 0.5
    read_value = reading(value, value / 50)
    assert again.backlash(read_value) == calibration.backlash(read_value)


@pytest.mark.parametrize("method", ["paper", "amplitude", "energy"])
def test_the_committed_calibration_is_what_the_code_computes(method):
    kept, now = default_calibration(method), compute_default(method)
    assert kept.coefficients == pytest.approx(now.coefficients, rel=1e-6)
    assert kept.uncertainty_rad == pytest.approx(now.uncertainty_rad, rel=1e-4)
    assert (kept.range_rad, kept.provenance) == (now.range_rad, now.provenance)


def test_the_default_of_the_paper_is_equation_10_which_takes_rpm():
    A = published.value("table2.row05.theoretical")
    assert default_calibration("paper").delta_rad(A) == pytest.approx(
        equation_10().backlash_rad(A), rel=1e-12
    )


@settings(max_examples=50)
@given(value=st.floats(0.3, 1.0), half_width=st.floats(0, 0.1))
def test_the_interval_holds_the_backlash_and_is_no_narrower_than_the_calibration_allows(
    value, half_width
):
    calibration = default_calibration("energy")
    value = value * 0.3
    answer = calibration.backlash(reading(value, half_width * value))
    low, high = answer.interval_rad
    assert low <= answer.delta_rad <= high
    assert high - low >= 2 * 1.96 * calibration.uncertainty_rad * (1 - 1e-12)


@pytest.mark.parametrize(
    ("deltas", "words"),
    [
        ([1e-4] * 8, "1 different backlashes"),
        ([*LEVELS_RAD[1:], np.nan], "finite"),
        ([*LEVELS_RAD[1:], -1e-4], "negative"),
        ([1e-4, 2e-4], "each log needs"),
        (np.take(LEVELS_RAD, [0, 1, 5, 4, 3, 2, 6, 7]), r"grow|order"),
    ],
)
def test_unusable_backlashes_are_refused(records, deltas, words):
    for method in ("energy", "waveform"):
        with pytest.raises(ValueError, match=words):
            fit_calibration(records, deltas, method)


def test_a_calibration_that_says_hardly_more_than_its_range_is_refused(records):
    scattered = [4e-4, 12e-4, 5e-4, 13e-4, 9e-4, 17e-4, 10e-4, 18e-4]
    with pytest.raises(Refusal, match=r"the uncertainty, 0.7\d\d mrad, is 5\d% of the range"):
        fit_calibration(records, scattered, "energy")


def broken(**changes):
    content = json.loads(default_calibration("energy").to_json())
    return json.dumps({k: v for k, v in (content | changes).items() if v is not None})


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        broken(method="guess"),
        broken(coefficients=None),
        broken(coefficients=["a", "b"]),
        broken(coefficients=[1.0, float("nan")]),
        broken(range_rad=[2e-3, 1e-3]),
        broken(uncertainty_rad=-1),
        broken(turn_period_s=0),
        broken(waveforms={"delta_rad": [1, 2], "waveform_rps": [[1], [2]]}),
        broken(
            method="waveform",
            coefficients=[],
            waveforms={"delta_rad": [1] * 5, "waveform_rps": [[1.0, 2.0]] * 5},
        ),
    ],
)
def test_a_broken_calibration_file_is_refused_with_one_line(text):
    with pytest.raises(ValueError, match=r"^my file: not a (usable )?calibration") as caught:
        Calibration.from_json(text, "my file")
    assert "\n" not in str(caught.value)


def test_the_energy_s_interval_is_that_of_its_scatter_over_noises(records):
    rng = np.random.default_rng(5)
    readings = [read(add_noise(records[2], 0.2, rng), "energy") for _ in range(60)]
    scatter = np.std([r.value for r in readings])
    stated = np.mean([(r.interval[1] - r.interval[0]) / 2 / 1.96 for r in readings])
    # The window's search adds a little to the noise along the signature; 60 runs know an SD to 10 %.
    assert 0.8 < scatter / stated < 1.6


@pytest.mark.parametrize("method", ["energy", "waveform"])
def test_records_that_start_anywhere_are_measured_by_the_default_calibration(authors_data, method):
    # Both reach 1.0e-5 to 1.4e-5 on whole records.
    calibration = default_calibration(method)
    errors = []
    for level in range(3, 12):
        record = from_sample(load_noisy(level, 1), 37)
        errors.append(
            calibration.backlash(read(record, method, calibration.bank)).delta_rad
            - level_delta_rad(level)
        )
    assert np.mean(np.abs(errors)) < 1.5e-5
