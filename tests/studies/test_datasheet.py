"""What the datasheet counts."""

import pandas as pd
import pytest
from numpy import array, isnan, nan, where

from studies import datasheet


def sensor_rows(held: int, missed: int, refused: int, population: str = "faults") -> pd.DataFrame:
    """Rows of the whole sensor: logs of 1e-3 rad whose interval holds it or not, and logs without an answer."""
    low = array([9e-4] * held + [1.1e-3] * missed + [nan] * refused)
    rows = pd.DataFrame({"low_rad": low, "found_rad": low + 1e-4, "high_rad": low + 2e-4})
    verdict = where(isnan(low), "cannot tell", "backlash")
    return rows.assign(population=population, delta_rad=1e-3, refused=isnan(low), verdict=verdict)


def test_the_datasheet_counts_answers_among_logs_and_held_truths_among_answers():
    healthy = sensor_rows(0, 2, 1, "healthy").assign(delta_rad=1e-5)
    by_torque = sensor_rows(0, 5, 0, datasheet.STROKES[0])
    rows = pd.concat([sensor_rows(6, 2, 2), healthy, by_torque])
    sheet = datasheet.summarise_sensor(rows).set_index("population")
    assert sheet.loc["faults", ["logs", "answered", "covered"]].tolist() == [10, 0.8, 0.75]
    assert sheet.loc["faults", "rmse_rad"] == pytest.approx(1e-4)
    assert sheet.loc["healthy", ["false_alarms", "healthy", "ill"]].tolist() == [2, 3, 0]
    assert sheet.loc[datasheet.ALL_BY_SPEED, ["logs", "covered"]].tolist() == [13, 0.6]
    assert (sheet["answered_low"] < sheet["answered"]).all()


def test_no_backlash_is_a_false_all_clear_where_a_backlash_matters():
    told = sensor_rows(3, 0, 0).assign(verdict="no backlash", delta_rad=[0.0, 4e-5, 6e-5])
    row = datasheet.summarise_sensor(told).iloc[0]
    assert (row["false_all_clears"], row["ill"]) == (1, 1)


def test_criteria_hang_on_what_was_measured_and_not_on_silence():
    whole = {name: sensor_rows(20, 0, 0, name) for name in datasheet.SIZES}
    good = pd.concat(whole.values()).assign(found_rad=1e-3)
    silent = pd.concat(sensor_rows(0, 0, 20, name) for name in datasheet.SIZES)
    bars = [datasheet.against_criteria(datasheet.summarise_sensor(rows)) for rows in (good, silent)]
    assert bars[0]["met"].all()
    assert not bars[1]["met"].any()


@pytest.mark.slow
def test_the_whole_sensor_answers_a_log_of_each_population_or_says_why_not():
    rows = datasheet.measure_sensor(dict.fromkeys(datasheet.SIZES, 1), 7)
    assert rows["population"].tolist() == list(datasheet.SIZES)
    assert (rows["refused"] == (rows["reason"] != "")).all()
    assert (rows.loc[~rows["refused"], "low_rad"] <= rows.loc[~rows["refused"], "found_rad"]).all()
    again = datasheet.measure_sensor({"faults": 1}, 7)
    assert again["delta_rad"][0] == rows.set_index("population").loc["faults", "delta_rad"]
