import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import openpyxl
import pandas as pd
import pytest
from defusedxml import EntitiesForbidden
from hypothesis import given, settings
from hypothesis import strategies as st
from made_logs import TURN, noisy, table, write

from backlash.reading import tables
from backlash.reading.columns import LogFormat
from backlash.reading.prepare import read_log, record_of
from backlash.reading.tables import read_table
from backlash.refusals import CannotTell, UnusableLog

RECORD = noisy()


def read(path, form=TURN):
    return read_log(path, form)[0]


def refused(path, form=TURN):
    """The one line with which a log is refused."""
    with pytest.raises(UnusableLog) as caught:
        read_log(path, form)
    line = str(caught.value)
    assert "\n" not in line
    return line


def lines():
    return [f"{t:.4f},{v:.5f}" for t, v in zip(RECORD.t, RECORD.v, strict=True)]


# ---------------------------------------------------------------------------------------------------------------
# What is read


@pytest.mark.parametrize(
    ("header", "row", "decimal"),
    [
        ("time,speed", "{t:.4f},{v:.5f}", "."),
        ("Zeit [s];Drehzahl [rpm]", "{t:.4f};{rpm:.3f}", ","),
        ("time [ms]\tspeed_rps", "{ms:.1f}\t{v:.5f}", "."),
        ("# logger 4.2, axis 4\n# t omega", "{t:.4f}   {v:.5f}", "."),
        ("Time,Speed\ns,rpm", "{t:.4f},{rpm:.3f}", "."),
        ("t,state,motor speed (rad/s)", "{t:.4f},moving,{rad:.4f}", "."),
        ("", "{t:.4f},{v:.5f}", "."),
        ("timestamp,v", "2024-05-01T10:00:{t:07.4f},{v:.5f}", "."),
    ],
)
def test_text_is_read_whatever_its_delimiter_decimal_mark_header_and_units(header, row, decimal, tmp_path):
    rows = [
        row.format(t=t, ms=1000 * t, v=v, rpm=60 * v, rad=2 * np.pi * v)
        for t, v in zip(RECORD.t, RECORD.v, strict=True)
    ]
    content = "\n".join(rows).replace(".", decimal)
    path = tmp_path / "log.txt"
    path.write_text(f"{header}\n{content}\n", encoding="utf-8")
    found = read(path)
    np.testing.assert_allclose(found.v, RECORD.v, atol=1e-4)
    np.testing.assert_allclose(found.t, RECORD.t, atol=1e-6)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig", "latin-1"])
def test_text_is_read_in_the_encodings_of_spreadsheets(encoding, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,velocità\n" + "\n".join(lines()), encoding=encoding)
    np.testing.assert_allclose(read(path).v, RECORD.v, atol=1e-4)


def test_a_workbook_is_read_with_and_without_a_header(tmp_path):
    path = tmp_path / "log.xlsx"
    table(RECORD).to_excel(path, index=False)
    np.testing.assert_allclose(read(path).v, RECORD.v)
    book = openpyxl.Workbook()
    for row in [(), *zip(RECORD.t.tolist(), RECORD.v.tolist(), strict=True)]:
        book.active.append(row)
    book.save(path)
    np.testing.assert_allclose(read(path).v, RECORD.v)


def test_parquet_is_read_and_its_text_columns_left_out(tmp_path):
    pytest.importorskip("pyarrow", reason="reading Parquet needs the extra 'fleet'")
    path = tmp_path / "log.parquet"
    table(RECORD).assign(state="moving").to_parquet(path)
    np.testing.assert_allclose(read(path).v, RECORD.v)


def test_the_content_decides_and_not_the_ending(tmp_path):
    path = tmp_path / "log.xlsx"
    write(RECORD, path)
    np.testing.assert_allclose(read(path).v, RECORD.v, atol=1e-5)


def test_columns_can_be_given_by_name_or_number(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("a,b,c\n" + "\n".join(f"{line},7" for line in lines()), encoding="utf-8")
    for form in (replace(TURN, time="a", speed="b"), replace(TURN, time="1", speed="2")):
        np.testing.assert_allclose(read(path, form).v, RECORD.v, atol=1e-4)
    assert "no column of time" in refused(path)
    assert "'x'" in refused(path, replace(TURN, time="a", speed="x"))
    path.write_text("\n".join(f"{line},7" for line in lines()), encoding="utf-8")
    np.testing.assert_allclose(read(path, replace(TURN, speed="2")).v, RECORD.v, atol=1e-4)
    assert "3 columns without names" in refused(path)


def test_of_two_speeds_the_motors_is_taken_and_otherwise_the_user_is_asked():
    frame = table(RECORD)
    both = frame.assign(**{"load speed": 2.5, "motor speed": frame["speed [rps]"]}).drop(columns="speed [rps]")
    np.testing.assert_allclose(record_of(both, TURN, "log")[0].v, RECORD.v)
    with pytest.raises(UnusableLog, match=r"which column is the speed.*--speed"):
        record_of(frame.assign(**{"speed b": 1.0}).rename(columns={"speed [rps]": "speed a"}), TURN, "log")


@pytest.mark.parametrize(("unit", "factor"), [("rps", 1.0), ("rpm", 60.0), ("rad/s", 2 * np.pi), ("counts", 4096.0)])
def test_the_unit_is_as_given(unit, factor):
    frame = pd.DataFrame({"time": RECORD.t, "speed": factor * RECORD.v})
    found, _ = record_of(frame, replace(TURN, unit=unit, counts_per_turn=4096.0), "log")
    np.testing.assert_allclose(found.v, RECORD.v)


def test_a_unit_that_the_header_contradicts_is_refused():
    with pytest.raises(UnusableLog, match="says rps, --unit says rpm"):
        record_of(table(RECORD), replace(TURN, unit="rpm"), "log")


# ---------------------------------------------------------------------------------------------------------------
# What is done to it


@pytest.mark.parametrize(
    ("scale", "wrap", "form"),
    [
        (1.0, None, replace(TURN, unit="rps")),
        (1.0, 1.0, replace(TURN, unit="rps")),
        (2 * np.pi, 2 * np.pi, replace(TURN, unit="rad/s")),
        (2**19, 2**19, replace(TURN, unit="counts", counts_per_turn=2.0**19)),
        (2**12, 2**16, replace(TURN, unit="counts", counts_per_turn=2.0**12)),
        (2**12, None, replace(TURN, unit="counts", counts_per_turn=2.0**12)),
    ],
)
def test_a_position_is_unwrapped_and_differentiated(scale, wrap, form):
    turns = np.cumsum(RECORD.v) * 2e-3
    position = scale * turns if wrap is None else (scale * turns) % wrap
    found, notes = record_of(pd.DataFrame({"time": RECORD.t, "position": position}), form, "log")
    np.testing.assert_allclose(found.v, RECORD.v[1:], atol=1e-4)
    assert any("differentiated" in note for note in notes)
    assert any("unwrapped" in note for note in notes) == (wrap is not None)


@settings(max_examples=40, deadline=None)
@given(
    speed=st.floats(20, 240), direction=st.sampled_from([1.0, -1.0]), start=st.floats(0, 1), bits=st.integers(10, 20)
)
def test_wrapping_changes_nothing_as_long_as_a_sample_is_less_than_half_a_turn(speed, direction, start, bits):
    t = 2e-3 * np.arange(1500)
    counts = np.floor((start + direction * speed * t) * 2**bits)
    form = LogFormat(unit="counts", counts_per_turn=2.0**bits, gear_ratio=speed / 2.5)
    found = [record_of(pd.DataFrame({"t": t, "position": p}), form, "log")[0].v for p in (counts, counts % 2**bits)]
    np.testing.assert_array_equal(*found)


def test_a_commanded_speed_resolves_an_encoder_that_wraps_faster_than_it_is_sampled():
    turns = (np.cumsum(RECORD.v) * 2e-3 * 3.5) % 1.0  # 0.7 turns a sample
    frame = pd.DataFrame({"time": RECORD.t, "position [turns]": turns})
    found, _ = record_of(frame, replace(TURN, commanded_speed_rps=350.0), "log")
    np.testing.assert_allclose(found.v, 3.5 * RECORD.v[1:], atol=1e-6)


def test_a_fast_log_is_averaged_down():
    t = np.arange(48000) / 10000.0
    found, notes = record_of(pd.DataFrame({"t": t, "v": 100 + 0.1 * np.sin(9 * t)}), TURN, "log")
    assert found.t[1] - found.t[0] == pytest.approx(1e-3)
    assert any("averaged over 10" in note for note in notes)


def test_the_stretch_at_constant_speed_is_found_in_a_whole_movement():
    ramp = np.linspace(0, 100, 300)
    v = np.concatenate([np.zeros(200), ramp, RECORD.v, ramp[::-1], -ramp, np.full(500, -100.0), np.zeros(100)])
    v = v + np.random.default_rng(0).normal(0, 0.01, v.size)
    found, notes = record_of(pd.DataFrame({"t": 2e-3 * np.arange(v.size), "v": v}), TURN, "log")
    assert 0.9 * RECORD.v.size < found.v.size <= RECORD.v.size
    assert abs(found.v - 100).max() < 1.0
    assert any("used the constant speed from" in note for note in notes)


def test_a_motor_that_turns_backward_is_turned_round():
    found, notes = record_of(table(replace(RECORD, v=-RECORD.v)), TURN, "log")
    np.testing.assert_allclose(found.v, RECORD.v)
    assert any("backward" in note for note in notes)


def test_only_the_first_sixty_turns_of_a_long_log_are_used():
    v = np.tile(RECORD.v[:-1], 8)
    found, _ = record_of(pd.DataFrame({"t": 2e-3 * np.arange(v.size), "v": v}), TURN, "log")
    assert found.t[-1] == pytest.approx(24.0)


def test_a_first_row_whose_stamp_the_second_repeats_is_dropped():
    frame = pd.concat([table(RECORD).iloc[:1], table(RECORD)], ignore_index=True)
    found, notes = record_of(frame, TURN, "log")
    assert found.v.size == RECORD.v.size
    assert any("dropped the first row" in note for note in notes)


def test_the_turn_period_follows_from_the_gear_ratio():
    found, _ = record_of(table(RECORD), LogFormat(gear_ratio=40.0), "log")
    assert found.turn_period_s == pytest.approx(0.4, rel=1e-4)


# ---------------------------------------------------------------------------------------------------------------
# What is refused


def with_line(number, text):
    rows = ["time,speed", *lines()]
    rows[number] = text
    return "\n".join(rows)


BAD_TEXT = {
    "empty": ("", "the file is empty"),
    "blank": ("\n\n  \n", "blank lines"),
    "header only": ("time,speed\n", "header only"),
    "prose": ("The robot was fine today.\nNothing to report.\n", "no rows with two numbers"),
    "text in numbers": (with_line(500, "0.998,abc"), "row 501: speed is 'abc'"),
    "Inf": (with_line(500, "0.998,-inf"), "row 501: speed is '-inf'"),
    "a doubled stamp": (with_line(500, lines()[498]), "row 501: its time stamp repeats the one before"),
    "a backward stamp": (with_line(500, "0.5,100.1"), "row 501: its time stamp goes backward"),
    "a gap": ("\n".join(["time,speed", *lines()[:900], *lines()[1100:]]), r"row 902: a gap of 0.402 s"),
    "one sample": ("time,speed\n0.0,100.0\n", "1 sample;"),
    "one column": ("\n".join(["speed", *[line.split(",")[1] for line in lines()]]), "no rows with two numbers"),
    "too many fields": (with_line(500, "0.998,100.1,5"), "not a table"),
    "a spike": (with_line(500, "0.998,1e9"), "row 501: a spike"),
    "huge numbers": (with_line(500, "0.998,1e200"), "above 1e30"),
}


@pytest.mark.parametrize("what", sorted(BAD_TEXT))
def test_bad_text_is_refused_in_one_line_that_says_what_and_where(what, tmp_path):
    content, expected = BAD_TEXT[what]
    path = tmp_path / "log.csv"
    path.write_text(content, encoding="utf-8")
    line = refused(path)
    assert line.startswith(str(path))
    assert expected in line


def refused_speed(v, dt=2e-3, form=TURN):
    with pytest.raises(UnusableLog) as caught:
        record_of(pd.DataFrame({"t": dt * np.arange(len(v)), "v": v}), form, "log")
    return str(caught.value)


def test_a_constant_signal_is_refused():
    assert "never changes" in refused_speed(np.full(2401, 100.0))


def test_ten_hertz_are_refused_and_the_needed_rate_named():
    line = refused_speed(RECORD.v[:480], dt=0.1)
    assert "sampled at 10 Hz" in line
    assert "84 Hz" in line
    assert "time [ms]" in line


def test_a_rate_that_blunts_the_peaks_is_said():
    _, notes = record_of(pd.DataFrame({"t": 5e-3 * np.arange(960), "v": RECORD.v[:960]}), TURN, "log")
    assert any("read too low" in note for note in notes)


def test_a_saturated_speed_is_refused():
    assert "clipped at 100.2" in refused_speed(np.minimum(RECORD.v, 100.2))


@pytest.mark.parametrize(
    ("factor", "unit", "hint"), [(60, "rps", "rpm"), (1 / 60, "rpm", "rps"), (6.2832, None, "rad/s")]
)
@pytest.mark.parametrize("known", [{"commanded_speed_rps": 100.0}, {"gear_ratio": 40.0}])
def test_a_wrong_unit_is_recognised_by_its_factor(factor, unit, hint, known):
    form = replace(TURN, unit=unit, **known)
    per = {"rps": 1.0, "rpm": 60.0, None: 1.0}[unit]
    assert f"give --unit {hint}" in refused_speed(factor * per * RECORD.v, form=form)


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"turn_period_s": -1.0},
        {"turn_period_s": float("nan")},
        {"gear_ratio": 0.0},
        {"turn_period_s": 0.4, "speed": "a", "position": "b"},
        {"turn_period_s": 0.4, "unit": "mph"},
    ],
)
def test_options_that_make_no_sense_are_refused(wrong):
    with pytest.raises(UnusableLog):
        LogFormat(**wrong)


def test_counts_need_the_counts_of_a_turn_and_a_position_its_unit():
    frame = pd.DataFrame({"t": RECORD.t, "position": np.cumsum(RECORD.v)})
    with pytest.raises(UnusableLog, match="--counts-per-turn"):
        record_of(frame, replace(TURN, unit="counts"), "log")
    with pytest.raises(UnusableLog, match="unit of 'position' is not known"):
        record_of(frame, TURN, "log")
    with pytest.raises(UnusableLog, match="no unit rpm"):
        record_of(frame, replace(TURN, unit="rpm"), "log")


def test_a_folder_a_missing_file_and_an_unreadable_one_are_refused(tmp_path, monkeypatch):
    assert "a folder" in refused(tmp_path)
    assert "no such file" in refused(tmp_path / "missing.csv")
    assert "not a regular file" in refused(Path("/dev/null"))
    path = write(RECORD, tmp_path / "log.csv")

    def forbidden(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", forbidden)
    assert "no permission" in refused(path)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (bytes(range(256)), "neither text nor"),
        (b"\x1f\x8b" + bytes(50), "cannot be read"),
        (b"\xd0\xcf\x11\xe0" + bytes(50), "neither text nor"),
        (b"%PDF-1.7 ...", "neither text nor"),
        (b"PAR1" + bytes(50), "broken Parquet"),
        (b"PK\x03\x04" + bytes(50), "not a readable workbook"),
        (b"1," * 100_000, "first line is longer"),
    ],
)
def test_what_is_no_log_is_refused_by_what_it_is(content, expected, tmp_path):
    if expected == "broken Parquet":
        pytest.importorskip("pyarrow", reason="reading Parquet needs the extra 'fleet'")
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    assert expected in refused(path)


def test_ten_million_rows_are_refused_before_they_are_parsed(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_bytes(b"0.002,100.1\n" * 10_000_000)
    monkeypatch.setattr(pd, "read_csv", lambda *_, **__: pytest.fail("parsed"))
    assert "more than the 64 MiB" in refused(path)


def test_many_short_rows_are_refused_when_the_limit_is_reached(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "MOST_ROWS", 1000)
    path = tmp_path / "log.csv"
    path.write_text("1,2\n" * 3000, encoding="utf-8")
    assert "more than 1,000 rows" in refused(path)


def test_ten_million_rows_of_parquet_are_refused_by_their_number(tmp_path):
    pyarrow = pytest.importorskip("pyarrow", reason="reading Parquet needs the extra 'fleet'")
    from pyarrow import parquet

    path = tmp_path / "log.parquet"
    column = pyarrow.array(np.zeros(10_000_000))
    parquet.write_table(pyarrow.table({"t": column, "v": column}), path)
    assert "more than 2,000,000 rows" in refused(path)


# ---------------------------------------------------------------------------------------------------------------
# Workbooks that are none


def rewritten(path, change):
    """A workbook with members changed or added: `change` maps a name to bytes."""
    plain = path.with_name("plain.xlsx")
    table(RECORD).iloc[:50].to_excel(plain, index=False)
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            if name not in change:
                new.writestr(name, old.read(name))
        for name, content in change.items():
            new.writestr(name, content)
    return path


def test_a_workbook_with_macros_is_refused(tmp_path):
    assert "macros" in refused(rewritten(tmp_path / "a.xlsx", {"xl/vbaProject.bin": b"Sub Auto_Open()"}))
    kind = b'<Types><Override ContentType="application/vnd.ms-excel.sheet.macroEnabled.main+xml"/></Types>'
    assert "macros" in refused(rewritten(tmp_path / "b.xlsx", {"[Content_Types].xml": kind}))


def test_a_zip_bomb_is_refused_by_what_it_declares(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "MOST_UNPACKED_BYTES", 2**20)
    bomb = rewritten(tmp_path / "a.xlsx", {"xl/worksheets/sheet1.xml": bytes(2**22)})
    assert bomb.stat().st_size < 2**16
    assert "unpack to 4 MiB" in refused(bomb)


def test_a_zip_bomb_that_declares_less_than_it_holds_is_refused_too(tmp_path):
    bomb = rewritten(tmp_path / "a.xlsx", {"xl/worksheets/sheet1.xml": bytes(2**22)})
    content = bomb.read_bytes().replace((2**22).to_bytes(4, "little"), (1000).to_bytes(4, "little"))
    bomb.write_bytes(content)
    with zipfile.ZipFile(bomb) as bundle:
        assert bundle.getinfo("xl/worksheets/sheet1.xml").file_size == 1000
    assert "not a readable workbook" in refused(bomb)


@pytest.mark.parametrize("part", ["xl/worksheets/sheet1.xml", "xl/workbook.xml", "[Content_Types].xml"])
def test_a_workbook_that_defines_entities_is_refused_before_they_unfold(part, tmp_path):
    levels = [f'<!ENTITY e{k} "{f"&e{k - 1};" * 10 if k else "x" * 10}">' for k in range(12)]  # 1e13 letters in all
    bomb = f'<?xml version="1.0"?><!DOCTYPE x [{"".join(levels)}]><x>&e11;</x>'.encode()
    with pytest.raises(UnusableLog, match="not a readable workbook") as caught:
        read_table(rewritten(tmp_path / "a.xlsx", {part: bomb}))
    cause = caught.value.__cause__
    assert isinstance(cause.__cause__, EntitiesForbidden) or "entity amplification" in str(cause)  # by lxml


def test_a_workbook_of_very_wide_rows_is_refused(tmp_path):
    rows = b"".join(b'<row r="%d"><c r="XFD%d"><v>1</v></c></row>' % (k, k) for k in range(1, 200))
    start = b'<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>'
    content = start + rows + b"</sheetData></worksheet>"
    assert "more than 64 columns" in refused(rewritten(tmp_path / "a.xlsx", {"xl/worksheets/sheet1.xml": content}))


def test_a_plain_zip_is_no_workbook(tmp_path):
    path = tmp_path / "log.xlsx"
    with zipfile.ZipFile(path, "w") as bundle:
        bundle.writestr("log.csv", "0,100")
    assert "xl/workbook.xml" in refused(path)


# ---------------------------------------------------------------------------------------------------------------
# What cannot be told


@pytest.mark.parametrize(
    ("v", "reason"),
    [
        (RECORD.v[:500], "too short"),
        (RECORD.v - 100.0, "not constant speed"),
        (100 * np.sin(3 * RECORD.t) + 0.1 * RECORD.v, "not constant speed"),
        (RECORD.v + 0.8 * (RECORD.t - 2.4), "not constant speed: it drifts"),
        (np.concatenate([RECORD.v[:600], 0.5 * RECORD.v[:600], 1.5 * RECORD.v[:600]]), "not constant speed"),
    ],
)
def test_a_log_without_a_long_enough_constant_speed_has_no_answer(v, reason):
    with pytest.raises(CannotTell, match=reason):
        record_of(pd.DataFrame({"t": 2e-3 * np.arange(v.size), "v": v}), TURN, "log")


def test_a_gear_ratio_that_contradicts_the_turn_period_has_no_answer():
    with pytest.raises(CannotTell, match="not 80 rps"):
        record_of(table(RECORD), replace(TURN, gear_ratio=32.0), "log")
    with pytest.raises(CannotTell, match=r"wrong period: gear ratio 32 at .* makes turns of 0.32 s"):
        record_of(table(RECORD), replace(TURN, gear_ratio=32.0, commanded_speed_rps=100.0), "log")


@settings(max_examples=150, deadline=None)
@given(content=st.one_of(st.binary(max_size=400), st.text(alphabet="0123456789.,;:\t\n -eNanif#\"'", max_size=400)))
def test_random_files_are_read_or_refused(content, tmp_path_factory):
    path = tmp_path_factory.mktemp("random") / "log"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    try:
        frame = read_table(path)
    except UnusableLog as error:
        said = str(error)
    else:
        said = f"{frame.shape[1]} columns"
        assert frame.shape[1] <= tables.MOST_COLUMNS
    assert "\n" not in said
