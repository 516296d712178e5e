import zipfile
from dataclasses import replace

import numpy as np
import openpyxl
import pandas as pd
import pytest
from defusedxml import EntitiesForbidden
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash.reading import tables
from backlash.reading.columns import LogFormat
from backlash.reading.tables import read_table
from backlash.refusals import Refusal
from tests.logs import TURN, file, noisy, opened, read, refusal, rewritten, table, text

RECORD = noisy()


def evenly(v, form=TURN, dt=2e-3):
    return opened(dt * np.arange(len(v)), v, form)


# ---------------------------------------------------------------------------------------------------------------
# What is read


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
    pytest.importorskip("pyarrow", reason="reading Parquet needs the extra 'parquet'")
    path = tmp_path / "log.parquet"
    table(RECORD).assign(state="moving").to_parquet(path)
    np.testing.assert_allclose(read(path).v, RECORD.v)


def test_columns_can_be_given_by_name_or_number(tmp_path):
    path = file(tmp_path, text("a,b,c", "{t:.4f},{v:.5f},7"))
    for form in (replace(TURN, time="a", speed="b"), replace(TURN, time="1", speed="2")):
        np.testing.assert_allclose(read(path, form).v, RECORD.v, atol=1e-4)
    assert "'x'" in refusal(path, replace(TURN, time="a", speed="x"))
    file(tmp_path, text("", "{t:.4f},{v:.5f},7"))
    np.testing.assert_allclose(read(path, replace(TURN, speed="2")).v, RECORD.v, atol=1e-4)


# ---------------------------------------------------------------------------------------------------------------
# What is done to it


@pytest.mark.parametrize(
    ("scale", "wrap", "said"),
    [
        (1.0, None, {"unit": "rps"}),
        (1.0, 1.0, {"unit": "rps"}),
        (2 * np.pi, 2 * np.pi, {"unit": "rad/s"}),
        (2**19, 2**19, {"unit": "counts", "counts_per_turn": 2.0**19}),
        (2**12, 2**16, {"unit": "counts", "counts_per_turn": 2.0**12}),
    ],
)
def test_a_position_is_unwrapped_and_differentiated(scale, wrap, said):
    position = scale * np.cumsum(RECORD.v) * 2e-3
    log = opened(
        RECORD.t, position if wrap is None else position % wrap, replace(TURN, **said), "position"
    )
    np.testing.assert_allclose(log.recording.v, RECORD.v[1:], atol=1e-4)
    assert any("differentiated" in note for note in log.notes)
    assert any("unwrapped" in note for note in log.notes) == (wrap is not None)


@settings(max_examples=20)
@given(
    speed=st.floats(20, 240),
    direction=st.sampled_from([1.0, -1.0]),
    start=st.floats(0, 1),
    bits=st.integers(10, 20),
)
def test_wrapping_changes_nothing_as_long_as_a_sample_is_less_than_half_a_turn(
    speed, direction, start, bits
):
    t = 2e-3 * np.arange(1500)
    counts = np.floor((start + direction * speed * t) * 2**bits)
    form = LogFormat(unit="counts", counts_per_turn=2.0**bits, gear_ratio=speed / 2.5)
    found = [
        opened(t, position, form, "position").recording.v for position in (counts, counts % 2**bits)
    ]
    np.testing.assert_array_equal(*found)


def test_a_commanded_speed_resolves_an_encoder_that_wraps_faster_than_it_is_sampled():
    turns = (np.cumsum(RECORD.v) * 2e-3 * 3.5) % 1.0  # 0.7 turns a sample
    log = opened(RECORD.t, turns, replace(TURN, commanded_speed_rps=350.0), "position [turns]")
    np.testing.assert_allclose(log.recording.v, 3.5 * RECORD.v[1:], atol=1e-6)


def test_a_fast_log_is_averaged_down():
    log = evenly(100 + 0.1 * np.sin(9e-4 * np.arange(48000)), dt=1e-4)
    assert log.recording.t[1] == pytest.approx(1e-3)
    assert any("averaged over 10" in note for note in log.notes)


def test_only_the_first_sixty_turns_of_a_long_log_are_used():
    assert evenly(np.tile(RECORD.v[:-1], 8)).recording.t[-1] == pytest.approx(24.0)


# ---------------------------------------------------------------------------------------------------------------
# What is refused


def test_a_rate_that_blunts_the_peaks_is_said():
    assert any("read too low" in note for note in evenly(RECORD.v[:960], dt=5e-3).notes)


@pytest.mark.parametrize(
    ("factor", "unit", "hint"),
    [(60, "rps", "rpm"), (1 / 60, "rpm", "rps"), (6.2832, None, "rad/s")],
)
@pytest.mark.parametrize("known", [{"commanded_speed_rps": 100.0}, {"gear_ratio": 40.0}])
def test_a_wrong_unit_is_recognised_by_its_factor(factor, unit, hint, known):
    per = {"rps": 1.0, "rpm": 60.0, None: 1.0}[unit]
    frame = pd.DataFrame({"t": RECORD.t, "v": factor * per * RECORD.v})
    assert f"give --unit {hint}" in refusal(frame, replace(TURN, unit=unit, **known))


def test_a_speed_that_no_motor_reaches_is_asked_about():
    assert "is it in rpm, rad/s" in refusal(pd.DataFrame({"t": RECORD.t, "v": 60 * RECORD.v}), TURN)


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"turn_period_s": -1.0},
        {"turn_period_s": float("nan")},
        {"gear_ratio": 0.0},
        {"turn_period_s": 0.4, "speed": "a", "position": "b"},
        {"turn_period_s": 0.4, "unit": "mph"},
        {"turn_period_s": 0.4, "start_s": 1.0, "end_s": 1.0},
        {"turn_period_s": 0.4, "end_s": -1.0},
        {"turn_period_s": 0.4, "start_s": float("nan")},
    ],
)
def test_options_that_make_no_sense_are_refused(wrong):
    with pytest.raises(Refusal, match=r"give |there are"):
        LogFormat(**wrong)


def test_many_short_rows_are_refused_when_the_limit_is_reached(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "MOST_ROWS", 1000)
    assert "more than 1,000 rows" in refusal(file(tmp_path, "1,2\n" * 3000))


def test_ten_million_rows_of_parquet_are_refused_by_their_number(tmp_path):
    pyarrow = pytest.importorskip("pyarrow", reason="reading Parquet needs the extra 'parquet'")
    from pyarrow import parquet

    path = tmp_path / "log.parquet"
    column = pyarrow.array(np.zeros(10_000_000))
    parquet.write_table(pyarrow.table({"t": column, "v": column}), path)
    assert "more than 2,000,000 rows" in refusal(path)


# ---------------------------------------------------------------------------------------------------------------
# Workbooks that are none


SHEET = "xl/worksheets/sheet1.xml"
MACROS = (
    b'<Types><Override ContentType="application/vnd.ms-excel.sheet.macroEnabled.main+xml"/></Types>'
)


@pytest.mark.parametrize(
    "change", [{"xl/vbaProject.bin": b"Sub Auto_Open()"}, {"[Content_Types].xml": MACROS}]
)
def test_a_workbook_with_macros_is_refused(change, tmp_path):
    assert "a workbook with macros; save it as .xlsx without them" in refusal(
        rewritten(tmp_path / "a.xlsx", change)
    )


def test_a_workbooks_rows_are_counted_before_they_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "MOST_ROWS", 40)
    monkeypatch.setattr(openpyxl, "load_workbook", None)
    assert "more than 40 rows" in refusal(rewritten(tmp_path / "a.xlsx", {}))


def test_a_zip_bomb_is_refused_by_what_it_declares(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "MOST_UNPACKED_BYTES", 2**20)
    bomb = rewritten(tmp_path / "a.xlsx", {SHEET: bytes(2**22)})
    assert bomb.stat().st_size < 2**16
    assert "unpack to 4 MiB" in refusal(bomb)


def test_a_zip_bomb_that_declares_less_than_it_holds_is_refused_too(tmp_path):
    bomb = rewritten(tmp_path / "a.xlsx", {SHEET: bytes(2**22)})
    bomb.write_bytes(
        bomb.read_bytes().replace((2**22).to_bytes(4, "little"), (1000).to_bytes(4, "little"))
    )
    with zipfile.ZipFile(bomb) as bundle:
        assert bundle.getinfo(SHEET).file_size == 1000
    assert "not a readable workbook" in refusal(bomb)


@pytest.mark.parametrize("part", [SHEET, "xl/workbook.xml", "[Content_Types].xml"])
def test_a_workbook_that_defines_entities_is_refused_before_they_unfold(part, tmp_path):
    levels = [
        f'<!ENTITY e{k} "{f"&e{k - 1};" * 10 if k else "x" * 10}">' for k in range(12)
    ]  # 1e13 letters in all
    bomb = f'<?xml version="1.0"?><!DOCTYPE x [{"".join(levels)}]><x>&e11;</x>'.encode()
    with pytest.raises(Refusal, match="not a readable workbook") as caught:
        read_table(rewritten(tmp_path / "a.xlsx", {part: bomb}).read_bytes())
    cause = caught.value.__cause__
    assert isinstance(cause.__cause__, EntitiesForbidden) or "entity amplification" in str(
        cause
    )  # by lxml


def test_a_workbook_of_very_wide_rows_is_refused(tmp_path):
    rows = b"".join(b'<row r="%d"><c r="XFD%d"><v>1</v></c></row>' % (k, k) for k in range(1, 200))
    start = (
        b'<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>'
    )
    content = start + rows + b"</sheetData></worksheet>"
    assert "more than 64 columns" in refusal(rewritten(tmp_path / "a.xlsx", {SHEET: content}))


def test_an_empty_workbook_and_a_plain_zip_are_none(tmp_path):
    openpyxl.Workbook().save(tmp_path / "log.xlsx")
    assert "nothing but blank lines" in refusal(tmp_path / "log.xlsx")
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as bundle:
        bundle.writestr("log.csv", "0,100")
    assert "it has no xl/workbook.xml); unpack it, or save the log as CSV" in refusal(
        tmp_path / "log.zip"
    )


# ---------------------------------------------------------------------------------------------------------------
# What cannot be told


@pytest.mark.parametrize(
    ("v", "reason"),
    [
        (RECORD.v[:500], "too short"),
        (np.append(0.0, RECORD.v[:9]), "not constant speed"),
        (RECORD.v - 100.0, "not constant speed: the motor stands still"),
        (100 * np.sin(3 * RECORD.t) + 0.1 * RECORD.v, "not constant speed"),
        (RECORD.v + 0.8 * (RECORD.t - 2.4), "not constant speed: it drifts"),
        (
            np.concatenate([RECORD.v[:600], 0.5 * RECORD.v[:600], 1.5 * RECORD.v[:600]]),
            "not constant speed",
        ),
    ],
)
def test_a_log_without_a_long_enough_constant_speed_has_no_answer(v, reason):
    with pytest.raises(Refusal, match=reason):
        evenly(v)


def test_a_gear_ratio_that_contradicts_the_turn_period_has_no_answer():
    with pytest.raises(Refusal, match="the log keeps 100 rps longest, not 80 rps"):
        evenly(RECORD.v, replace(TURN, gear_ratio=32.0))
    with pytest.raises(Refusal, match=r"wrong period: gear ratio 32 at .* makes turns of 0.32 s"):
        evenly(RECORD.v, replace(TURN, gear_ratio=32.0, commanded_speed_rps=100.0))


@settings(max_examples=150)
@given(
    content=st.one_of(
        st.binary(max_size=400), st.text(alphabet="0123456789.,;:\t\n -eNanif#\"'", max_size=400)
    )
)
def test_random_files_are_read_or_refused(content):
    try:
        frame = read_table(content if isinstance(content, bytes) else content.encode())
    except Refusal as error:
        said = str(error)
    else:
        said = f"{frame.shape[1]} columns"
        assert frame.shape[1] <= tables.MOST_COLUMNS
    assert "\n" not in said
