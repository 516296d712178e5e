"""Tables that list logs are text, converted cell by cell."""

import pandas as pd
import pytest

from backlash.reading.batch import keys_of, options_of, read_rows
from backlash.refusals import Refusal
from tests.logs import file

CSV = "file,joint,date,turn_period_s,torque,trust_period\na.csv,007,2024-03-17,0.4,3,no\nb.csv,=1+1,,?,,maybe\n"


@pytest.fixture(params=["csv", "semicolons", "utf-16", "parquet"])
def rows(request, tmp_path):
    path = tmp_path / "plant"
    if request.param == "parquet":
        pytest.importorskip("pyarrow", reason="reading Parquet needs the extra 'parquet'")
        pd.read_csv(file(tmp_path, CSV), dtype=str).to_parquet(path)
    else:
        text = CSV.replace(",", ";") if request.param == "semicolons" else CSV
        path.write_text(text, "utf-16" if request.param == "utf-16" else "utf-8")
    return read_rows(path, "file")


def test_each_cell_is_what_its_column_holds(rows):
    first = rows.to_dict("records")[0]
    assert options_of(first) == {
        "file": "a.csv",
        "joint": "007",
        "date": pd.Timestamp("2024-03-17"),
        "turn_period_s": 0.4,
        "torque": "3",
        "trust_period": False,
    }


def test_joints_are_escaped_as_files_are_and_a_bad_date_is_missing(rows):
    rows.loc[1, "date"] = "2024-13-45"
    keys = keys_of(rows)
    assert keys["joint"].tolist() == ["007", "'=1+1"]
    assert keys["date"].isna().tolist() == [False, True]
    with pytest.raises(Refusal, match="date is '2024-13-45', no date like 2024-03-17"):
        options_of({"date": "2024-13-45"})


@pytest.mark.parametrize(
    ("text", "why"), [("a,b\n1,2\n", "no column 'file'; there are 'a', 'b'"), ("file\n", "no rows")]
)
def test_a_table_that_lists_no_logs_is_refused(text, why, tmp_path):
    with pytest.raises(Refusal, match=why):
        read_rows(file(tmp_path, text), "file")
