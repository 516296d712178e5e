"""Every kind of file that loggers and spreadsheets write, and what is none: read rightly or refused in one line."""

import gzip
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet
import pytest
from openpyxl.chart import ScatterChart

from backlash.batch import read_batch
from backlash.reading import limits
from backlash.refusals import Refusal
from tests.logs import T, V, file, frame, read, refusal, rewritten, text

RPM = ("Zeit [s];Drehzahl [U/min]", "{t:.4f};{rpm:.2f}")
PLAIN = text()
PLC = "Name\tAchse1\t\t\nFile\tTrace\t\t\ntime\tspeed [rpm]\ttime\tmoment\n"
LABVIEW = (
    "LabVIEW Measurement\nSeparator\tTab\nDate\t2024/05/01\nTime\t12:00:00,1\n***End_of_Header***\n\n"
    "Channels\t2\nSamples\t2401\t2401\nX0\t0,0E+0\t0,0E+0\n***End_of_Header***\n"
    "time [s]\tspeed [rpm]\ttorque\tComment\n"
)


def line(number: int, changed: str) -> str:
    """The plain log with one line changed."""
    rows = PLAIN.splitlines()
    rows[number - 1] = changed
    return "\n".join(rows)


def clocked(form: str) -> str:
    """Stamps as dates and times of day, over midnight."""
    stamps = pd.Timestamp("2024-03-17 23:59:58") + pd.to_timedelta(T, unit="s")
    return frame(t=stamps).to_csv(index=False, date_format=form)


ANSWERED = {
    "UTF-16": PLAIN.encode("utf-16"),
    "a byte order mark": PLAIN.encode("utf-8-sig"),
    "Latin-1": text("time,velocità [rps]").encode("latin-1"),
    "lines that end as in DOS": PLAIN.replace("\n", "\r\n"),
    "semicolons and decimal commas": text(*RPM).replace(".", ","),
    "blanks": text("  time   speed_rps", "  {t:.4f}   {v:.5f}"),
    "a header in a comment": text("# logger 4.2, axis 4\n# t omega_rps", "{t:.4f}   {v:.5f}"),
    "a column of text": text("t,state,motor speed (rad/s)", "{t:.4f},moving,{rad:.4f}"),
    "a row of units": text("Time,Speed,I\ns,rpm,A", "{t:.4f},{rpm:.2f},1"),
    "a row of units and one of types": text(
        "Time;Act velocity;I\nms;rpm;A\nREAL8;REAL4;REAL4", "{t:.4f};{rpm:.2f};1"
    ).replace("ms;", "s;"),
    "a word below the names": text("time [s],speed [rpm]\nTrace1", "{t:.4f},{rpm:.2f}"),
    "decimal commas with three digits beside whole stamps": text(
        "t [ns];speed [rps];I", "{ns};{v:.3f};1.024"
    ).replace(".", ","),
    "motor and joint above each name": text(
        "t,Motor,Joint\ntime [s],speed [rpm],speed [rpm]", "{t:.4f},{rpm:.3f},7"
    ),
    "merged cells": text(",Motor,,Joint\ntime,speed,I,speed\ns,rpm,A,rpm", "{t:.4f},{rpm:.3f},1,7"),
    "quoted numbers": text('"time","speed_rps"', '"{t:.4f}","{v:.5f}"'),
    "thousands with narrow spaces": text("time [s];speed [rpm]", "{t:.4f};{rpm:,.3f}").replace(
        ",", "\u202f"
    ),
    "a row without a stamp": line(500, ",100.0"),
    "blank rows": PLAIN.replace("\n", "\n\n"),
    "blank columns": text(",time,,speed [rps],", ",{t:.4f},,{v:.5f},"),
    "a trailing comma in the rows": text("time,speed [rps]", "{t:.4f},{v:.5f},"),
    "a line break in a header cell": text('time,"speed\n[rpm]"', "{t:.4f},{rpm:.3f}"),
    "a header of numbers": text("time,1,speed [rps],torque", "{t:.4f},7,{v:.5f},7"),
    "a compressed log": gzip.compress(PLAIN.encode()),
    "LabVIEW": LABVIEW + text("", "{t:.4f}\t{rpm:.3f}\t1.5").replace(".", ","),
    "dates and times": clocked("%Y-%m-%dT%H:%M:%S.%f"),
    "German dates": clocked("%d.%m.%Y %H:%M:%S.%f"),
    "American dates": clocked("%m/%d/%Y %I:%M:%S.%f %p"),
    "times of day over midnight": clocked("%H:%M:%S.%f"),
}

REFUSED = {
    "empty": ("", "the file is empty; export the log again"),
    "binary": (bytes(range(256)) * 9, "export the log as CSV"),
    "units in the cells": (
        text("time,speed", "{t:.3f} sec,{v:.3f} rps"),
        "last line is '4.800 sec,",
    ),
    "text among numbers": (line(500, "0.996,error"), "row 500: speed [rps] is 'error', no number"),
    "a huge speed": (line(500, "0.996,1e200"), "row 500: speed [rps] is '1e+200'"),
    "a second log below": (line(100, "time [s],speed [rps]"), "row 100: names in the midst"),
    "a word in an early row, and later ones": (
        "\n".join([*PLAIN.splitlines()[:5], "overrun,overrun", *PLAIN.splitlines()[5:], "end,end"]),
        "row 6: names in the midst",
    ),
    "a comma in a header cell": (
        text("time,motor speed, filtered [rpm]", "{t:.4f},{rpm:.3f}"),
        "its header has 3 fields, its rows have 2",
    ),
    "a setpoint above units of other columns": (
        text("time,target speed,I,temp,U\ns,rpm,A,°C,V", "{t:.4f},{rpm:.3f},1,1,1"),
        "no column of a measured speed",
    ),
    "an index without a name": (text("time,speed [rpm]", "1,{t:.4f},{rpm:.3f}"), "has 2 fields"),
    "points of thousands and decimal commas": (
        text(RPM[0], "{t:.4f};{rpm:,.2f};1.5")
        .replace("n]", "n];I", 1)
        .translate(str.maketrans(",.", ".,")),
        "row 2: Drehzahl [U/min] has marks of thousands; export numbers without",
    ),
    "stamps of no known format": (
        text("time,speed [rps],I", "{t:.4f} after the start,{v:.5f},1"),
        "time has text like '0.0000 after the start'; export it as numbers",
    ),
    "a row for each value": (
        "time,topic,value\n" + text("", "{t:.4f},/v,{v:.5f}\n{t:.4f},/i,1.5"),
        "each row has one value, of '/v', '/i'; pivot the table by 'topic'",
    ),
    "a stamp of ROS in two columns": (
        text("__time,stamp.sec,stamp.nanosec,velocity [rps]", "{t:.1f},1710000000,{ns},{v:.5f}"),
        "its time stamp repeats the one before with other values",
    ),
    "half of a stamp of ROS": (
        text("stamp.sec,stamp.nanosec,velocity [rps]", "1710000000,{ns},{v:.5f}"),
        "'stamp.nanosec' is a part of a stamp in two columns; export it as one",
    ),
    "no time": (text("a,speed [rps]"), "no column of time among 'a', 'speed [rps]'; give --time"),
    "a PLC's two times": (PLC + text("", "{t}\t{rpm}\t{t}5\t1"), "which column is the time"),
    "a very long line": (b"1," * 100_000, "no rows with 2 numbers in its first 65536 characters"),
    "too many fields": (
        line(500, "0.996,100.0,5"),
        "row 500: it has a number beyond the 2 columns of the header",
    ),
    "two columns without names": (text(""), "give --unit"),
    "three columns without names": (text("", "{t},{v},7"), "give --time and --speed by number"),
    "two rows": (
        "time,speed [rps]\n0,1\n1,2\n",
        "in 2 rows) stand in 2 rows together; log all at the same instants",
    ),
    "a quote that never ends": (PLAIN + '"', "not a table below line 1 (Error tokenizing data"),
    "a broken gzip file": (gzip.compress(PLAIN.encode())[:9000], "or export it again"),
    "a broken zip": (b"PK\x03\x04" + bytes(99), "no readable workbook or Parquet file"),
    "dates that break off": (
        clocked("%Y-%m-%dT%H:%M:%S.%f").replace("17T23:59:59.000000", "17Tnever"),
        "row 502: time is no date-time",
    ),
}


@pytest.mark.parametrize("kind", ANSWERED)
def test_a_log_is_read_however_it_is_written(kind, tmp_path):
    recording = read(file(tmp_path, ANSWERED[kind], "log")).recording
    # Rows at the start may be missing.
    assert np.quantile(np.abs(recording.v[-2390:] - V[-2390:]), 0.98) < 0.03
    assert recording.t[1] == pytest.approx(2e-3, rel=1e-6)


@pytest.mark.parametrize("kind", REFUSED)
def test_what_cannot_be_read_is_refused_in_one_line_that_says_why(kind, tmp_path):
    content, why = REFUSED[kind]
    path = file(tmp_path, content, "log")
    sentence = refusal(path)
    assert sentence.startswith(str(path))
    assert why in sentence


def test_a_table_without_names_is_read_by_number(tmp_path):
    path = file(tmp_path, text("", "{t:.4f},{v:.5f},7"))
    log = read(path, time="1", speed="2", unit="rps")
    np.testing.assert_allclose(log.recording.v, V, atol=1e-4)


@pytest.mark.parametrize("name", ["", "missing.csv", "log\0.csv"])
def test_what_is_no_file_is_refused(name, tmp_path):
    assert "; check its name" in refusal(Path(f"{tmp_path}/{name}"))


SHEETS = ["hidden", "other", "run"]


@pytest.mark.parametrize(
    ("active", "chosen"),
    [("run", "run"), ("other", "other"), ("hidden", "other"), ("chart", "other")],
)
def test_of_a_workbook_the_active_visible_sheet_is_read_and_named(active, chosen, tmp_path):
    with pd.ExcelWriter(tmp_path / "log.xlsx") as writer:
        for name in SHEETS:
            log = pd.DataFrame({"time": T, "state": None, "speed\n[rps]": V})
            rows = None if name == chosen else 5  # too short for an answer
            log[:rows].to_excel(writer, sheet_name=name, startrow=1, index=False)
        writer.book["hidden"].sheet_state = "hidden"
        writer.book.create_chartsheet("chart").add_chart(ScatterChart())
        writer.book.active = [*SHEETS, "chart"].index(active)
    log = read(tmp_path / "log.xlsx")
    np.testing.assert_allclose(log.recording.v, V)
    assert f"sheet {chosen!r} (not 'hidden', " in str(log.columns)


DAY = pd.Timestamp("2024-03-17 08:00") + pd.to_timedelta(T, unit="s")


@pytest.mark.parametrize("stamps", [DAY - DAY[0], DAY.time, DAY.astype(str)])
def test_columns_of_parquet_are_read_and_those_of_no_numbers_are_told(stamps, tmp_path):
    path = tmp_path / "log.parquet"
    log = frame(t=stamps).assign(state="moving", I=[[1.5]] * T.size)
    log[["time", "state", "speed [rps]", "I"]].to_parquet(path)
    np.testing.assert_allclose(read(path, speed="3").recording.v, V)
    assert "row 1: state has text like 'moving'; export it as" in refusal(path, torque="state")
    assert "row 1: I has text like '[1.5]'; export it as" in refusal(path, torque="I")


def test_columns_with_one_name_are_refused(tmp_path):
    twice = pa.table([T, V, V], names=["time", "speed [rps]", "speed [rps]"])
    pa.parquet.write_table(twice, tmp_path / "log.parquet")
    assert "several of its columns have one name" in refusal(tmp_path / "log.parquet")


def test_a_column_of_formulas_that_no_program_has_calculated_is_named(tmp_path):
    log = frame(I=[f"={k}" for k in range(T.size)])
    log.to_excel(tmp_path / "log.xlsx", index=False)
    words = "'I' is empty in all 2,401 rows (in a workbook: a formula, until a spreadsheet program"
    assert words in refusal(tmp_path / "log.xlsx", torque="I")


SHEET = "xl/worksheets/sheet1.xml"
START = b'<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>'
WIDE = b"".join(b'<row r="%d"><c r="XFD%d"><v>1</v></c></row>' % (k, k) for k in range(1, 600))


def entities() -> bytes:
    levels = (f'<!ENTITY e{k} "{f"&e{k - 1};" * 10 if k else "x" * 10}">' for k in range(12))
    return f'<?xml version="1.0"?><!DOCTYPE x [{"".join(levels)}]><x>&e11;</x>'.encode()


@pytest.mark.parametrize(
    ("part", "content", "why"),
    [
        (SHEET, bytes(2**24), "more than 8 MiB, packed or not"),
        (SHEET, START + b"<row>" + b"<c/>" * 300_000, "37,500 columns, more than 4,096"),
        (SHEET, START + WIDE + b"</sheetData></worksheet>", "more than 50,000 cells"),
        ("xl/styles.xml", b"<a/>" * 100_000, "styles and relations have 100,"),
        (SHEET, entities(), "no readable workbook"),
        (SHEET, START + b"</sheetData></worksheet>", "no rows with 2 numbers"),
    ],
)
def test_a_hostile_workbook_is_refused(part, content, why, tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "MOST_BYTES", 2**23)
    monkeypatch.setattr(limits, "MOST_CELLS", 50_000)
    assert why in refusal(rewritten(tmp_path / "a.xlsx", {part: content}))


def test_bytes_and_cells_are_bounded_however_they_are_packed(tmp_path, monkeypatch):
    wide = ",".join(["a name"] * 4097) + "\n" + ",".join(["1.25"] * 4097)
    assert "4,097 columns, more than 4,096" in refusal(file(tmp_path, wide))
    monkeypatch.setattr(limits, "MOST_CELLS", 1000)
    for content in ("1,2\n" * 3000, frame().to_parquet()):
        assert "more than 1,000 cells" in refusal(file(tmp_path, content))
    monkeypatch.setattr(limits, "MOST_BYTES", 2**16)
    path = file(tmp_path, gzip.compress(b"1,2\n" * 2**20))
    assert "MiB, packed or not; cut it to the test movement" in refusal(path)


def test_tables_of_logs_are_bounded_by_what_they_unpack_to_and_by_their_rows(tmp_path, monkeypatch):
    table = pd.DataFrame({"file": ["x" * 1000] * 1000})
    path = tmp_path / "plant.parquet"
    table.to_parquet(path)
    assert len(read_batch(path, {})) == 1000
    for limit, most, words in (
        ("MOST_LOGS", 999, "1,000 logs, more than 999; split the table"),
        ("MOST_BYTES", 999_999, "MiB, packed or not"),
    ):
        monkeypatch.setattr(limits, limit, most)
        with pytest.raises(Refusal, match=words):
            read_batch(path, {})
