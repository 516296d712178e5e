"""Every kind of log that engineers' loggers and spreadsheets write, and what is none: read rightly or refused."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from backlash.reading.prepare import open_log
from replication.records import Recording
from tests.logs import TURN, file, noisy, refusal, text

RPM = ("Zeit [s];Drehzahl [U/min]", "{t:.4f};{rpm:.2f}")


def line(number: int, changed: str | None) -> str:
    """The plain log with one line changed, or left out."""
    rows = text().splitlines()
    rows[number - 1 : number] = [] if changed is None else [changed]
    return "\n".join(rows)


def spoilt(t=None, v=None, header="time [s],speed [rps]") -> str:
    t, v = noisy().t if t is None else t, noisy().v if v is None else v
    return text(header, record=Recording(t, v, 100.0, 0.4, "log"))


def dropped(*places: int) -> str:
    return spoilt(np.delete(noisy().t, places), np.delete(noisy().v, places))


def with_value(place: int, value: float) -> np.ndarray:
    v = noisy().v.copy()
    v[place] = value
    return v


def grouped(separator: str, decimal: str, between: str) -> str:
    """Speeds in rpm with marks of thousands, quoted."""
    rows = (f"{t:.4f}|{60 * v:,.3f}" for t, v in zip(noisy().t, noisy().v, strict=True))
    swapped = (row.translate(str.maketrans(",.", separator + decimal)).split("|") for row in rows)
    return "\n".join(
        ["time" + between + "speed [rpm]", *(f'{t}{between}"{v}"' for t, v in swapped)]
    )


TURNS = np.concatenate([[0.25], 0.25 + np.cumsum(noisy().v[1:]) * 2e-3])

ANSWERED = {
    "a plain log": text(),
    "UTF-16": text().encode("utf-16"),
    "a byte order mark": text().encode("utf-8-sig"),
    "Latin-1": text("time,velocità [rps]").encode("latin-1"),
    "lines that end as in DOS": text().replace("\n", "\r\n").encode(),
    "lines that end as on old Macs": text().replace("\n", "\r").encode(),
    "semicolons and decimal commas": text(*RPM).replace(".", ","),
    "tabs": text("time\tspeed", "{t:.4f}\t{v:.5f}"),
    "blanks": text("  time   speed", "  {t:.4f}   {v:.5f}"),
    "comments": "# logger 4.2\n% axis 4\n" + text(),
    "a header in a comment": text("# logger 4.2, axis 4\n# t omega", "{t:.4f}   {v:.5f}"),
    "a column of text": text("t,state,motor speed (rad/s)", "{t:.4f},moving,{rad:.4f}"),
    "dates without a zone": text("timestamp,v", "2024-05-01T10:00:{t:07.4f},{v:.5f}"),
    "a row of units": text("Time,Speed\ns,rpm", "{t:.4f},{rpm:.2f}"),
    "a row of units with exponents": text("Time;Speed\ns;rad s^-1", "{t:.4f};{rad:.4f}"),
    "quoted numbers": text('"time","speed"', '"{t:.4f}","{v:.5f}"'),
    "thousands in English": grouped(",", ".", ","),
    "thousands in German": grouped(".", ",", ";"),
    "rows without a number": line(500, "0.996,NaN"),
    "a row without a stamp": line(500, ",100.0"),
    "NaN in the time": line(500, "nan,100.0"),
    "milliseconds": spoilt(1000 * noisy().t, header="time [ms],speed [rps]"),
    "negative speed": spoilt(v=-noisy().v),
    "a position that wraps, with samples dropped": spoilt(
        np.delete(noisy().t, [600, 601]), np.delete(TURNS, [600, 601]) % 1.0, "time,position [rev]"
    ),
    "a position in degrees": spoilt(v=360 * TURNS, header="time,angle_deg"),
    "no header": text(""),
    "blank rows": text().replace("\n", "\n\n"),
    "blank columns": text(",time,,speed,", ",{t:.4f},,{v:.5f},"),
    "a compressed log": gzip.compress(text().encode()),
    "German dates": text("Zeit;speed", "17.03.2024 12:00:0{t:.3f};{v:.5f}")
    .replace(".", ",")
    .replace("17,03,2024", "17.03.2024"),
    "dates with a zone": text("time,speed", "2024-03-17T12:00:0{t:.3f}Z,{v:.5f}"),
    "names of ROS": text(
        "header.stamp.sec,header.stamp.nanosec,velocity[0]", "1710000000,{ns},{v:.5f}"
    ),
    "two rows where one stamp is repeated at the start": line(2, f"{noisy().t[1]:.6f},100.0"),
}

REFUSED = {
    "empty": ("", "the file is empty; export the log again"),
    "blank": (" \n\n", "nothing but blank lines"),
    "header only": ("time,speed\n", "no rows with two numbers (header only"),
    "prose": ("The robot was fine.\nNothing to report.\n", "no rows with two numbers"),
    "binary": (bytes(range(256)) * 9, "export the log as CSV"),
    "a PDF": (b"%PDF-1.7\n", "neither text nor .xlsx"),
    "an old Excel file": (b"\xd0\xcf\x11\xe0" + bytes(99), "neither text nor .xlsx"),
    "text among numbers": (
        line(500, "0.996,error"),
        "row 500: speed [rps] is 'error', no finite number",
    ),
    "an infinite speed": (line(500, "0.996,-inf"), "row 500: speed [rps] is '-inf'"),
    "a huge speed": (line(500, "0.996,1e200"), "above 1e30; that is no measurement"),
    "a repeated stamp": (
        line(500, "0.994000,100.0"),
        "row 500: its time stamp repeats the one before",
    ),
    "a stamp that goes backward": (line(500, "0.5,100.0"), "row 500: its time stamp goes backward"),
    "a clipped speed": (
        spoilt(v=np.minimum(noisy().v, 100.2)),
        "the speed is clipped at 100.2 rps",
    ),
    "a spike": (spoilt(v=with_value(500, 900.0)), "row 502: a spike, 900 rps"),
    "gaps": (
        dropped(*range(700, 800), *range(1550, 1650)),
        "row 702: a gap of 0.202 s in the constant speed, at t = 1.398 s",
    ),
    "a speed that never changes": (
        spoilt(v=np.full(2401, 100.0)),
        "never changes, it is 100 throughout",
    ),
    "one sample": ("time,speed\n0.0,100.0\n", "1 sample;"),
    "ten hertz": (
        spoilt(0.1 * np.arange(2401)),
        "sampled at 10 Hz; the 21 Hz oscillation after an impact needs 84 Hz",
    ),
    "a very long line": (b"1," * 100_000, "first line is longer than 65536 characters"),
    "a very long line further down": (
        line(500, "0.996," + "1" * 200_000),
        "row 500: speed [rps] is",
    ),
    "a row with too many fields": (
        line(500, "0.996,100.0,5"),
        "not a table (Error tokenizing data",
    ),
    "two columns of one name": (
        text("time,speed,speed", "{t:.4f},{v:.4f},{v:.4f}"),
        "which column is the speed",
    ),
    "three columns without names": (
        text("", "{t:.4f},{v:.4f},7"),
        "give --time and --speed by number",
    ),
    "no time": (text("a,speed"), "no column of time among 'a', 'speed'; give --time"),
    "no speed": (
        text("time,current"),
        "no column of speed or position among 'time', 'current'; give --speed",
    ),
    "an unknown unit of time": (text("time [ticks],speed"), "is not known; there are s,"),
    "counts of an unknown encoder": (text("time,speed [counts/s]"), "give --counts-per-turn"),
    "a position without a unit": (
        spoilt(v=TURNS, header="time,position"),
        "the unit of 'position' is not known",
    ),
    "dates that break off": (
        text("time,speed", "2024-03-17T12:00:0{t:.3f}Z,{v:.5f}").replace(
            "T12:00:01.000Z", "Tnever"
        ),
        "row 502: time is no date-time",
    ),
    "a broken gzip file": (gzip.compress(text().encode())[:9000], "or export it again"),
    "a compressed binary": (gzip.compress(bytes(999)), "export the log as CSV"),
    "a broken zip": (b"PK\x03\x04" + bytes(99), "not a readable workbook"),
}


@pytest.mark.parametrize("kind", ANSWERED)
def test_a_log_is_read_however_it_is_written(kind, tmp_path):
    found = open_log(file(tmp_path, ANSWERED[kind], "log"), TURN).recording
    whole = noisy().v - 100
    start = int(np.correlate(whole, found.v[:2000] - 100, mode="valid").argmax())
    apart = np.abs(found.v[:2000] - noisy().v[start : start + 2000])
    assert np.quantile(apart, 0.98) < 0.03
    assert found.t[1] == pytest.approx(2e-3, rel=1e-6)
    assert found.v.size >= 2150


@pytest.mark.parametrize("kind", REFUSED)
def test_what_cannot_be_read_is_refused_in_one_line_that_says_why(kind, tmp_path):
    content, why = REFUSED[kind]
    path = file(tmp_path, content, "log")
    said = refusal(path)
    assert said.startswith(str(path))
    assert why in said


def test_a_folder_a_missing_file_and_a_forbidden_one_are_refused(tmp_path, monkeypatch):
    assert "a folder where a file is needed; name a file in it" in refusal(tmp_path)
    assert f"no such file in {tmp_path}; check" in refusal(tmp_path / "missing.csv")
    assert "check its name" in refusal(Path("log\0.csv"))
    assert "the file is empty" in refusal(Path("/dev/null"))
    path = file(tmp_path, text())

    def forbidden(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", forbidden)
    assert "no permission to read it; ask its owner for it" in refusal(path)
