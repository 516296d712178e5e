"""The authors' files are read and verified, ours take their place, and a wrong folder is named."""

import hashlib
import io
import zipfile

import numpy as np
import pytest

from replication import published, records
from replication.records import DataCorrupt, DataUnavailable

SHEET = """<?xml version="1.0"?><worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>
<row r="1"/>{rows}</sheetData></worksheet>"""


def make_workbook(table) -> io.BytesIO:
    rows = "".join(
        "<row>" + "".join(f'<c r="A1"><v>{value!r}</v></c>' for value in row) + "</row>"
        for row in table
    )
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("xl/worksheets/sheet1.xml", SHEET.format(rows=rows))
    content.seek(0)
    return content


def test_a_worksheet_of_numbers_is_read_without_its_blank_rows():
    table = [[0.0, 100.07], [2e-3, 99.5], [4e-3, 1e2]]
    np.testing.assert_array_equal(records.read_worksheet(make_workbook(table)), table)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where a copy of one registered file belongs."""
    digest = hashlib.sha256(b"the authors' bytes").hexdigest()
    monkeypatch.setattr(records, "authors_checksums", lambda: {"a file.zip": digest})
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    return tmp_path


def test_a_file_of_the_folder_is_verified(folder):
    (folder / "a file.zip").write_bytes(b"the authors' bytes")
    assert records.authors_file("a file.zip") == folder / "a file.zip"
    (folder / "a file.zip").write_bytes(b"the authors' byte")
    with pytest.raises(DataCorrupt, match="SHA-256"):
        records.authors_file("a file.zip")


@pytest.mark.parametrize("is_folder", [True, False])
def test_a_folder_without_the_file_is_named_with_its_variable(folder, is_folder):
    if is_folder:
        (folder / "a file.zip").mkdir()
    with pytest.raises(DataCorrupt, match=r"a file\.zip.*BACKLASH_DATA"):
        records.authors_file("a file.zip")


def test_without_network_and_folder_the_variable_is_named(monkeypatch, tmp_path):
    monkeypatch.delenv("BACKLASH_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(records, "AUTHORS_URL", "http://127.0.0.1:9/")
    with pytest.raises(DataUnavailable, match=r"Speeddata3\.xlsx.*BACKLASH_DATA"):
        records.authors_file("Speeddata3.xlsx")


def test_noise_is_uniform_within_its_half_amplitude():
    quiet = records.constant_speed()
    noise = records.add_noise(quiet, 0.2, np.random.default_rng(1)).v - quiet.v
    assert 0.199 < np.abs(noise).max() <= 0.2
    assert noise.std() == pytest.approx(0.2 / np.sqrt(3), rel=0.03)
    assert abs(noise.mean()) < 0.01


def test_the_noise_of_a_level_is_the_printed_one():
    printed = published.column("Table 2", "noise")[:10]
    levels = [records.noise_half_amplitude_rps(level) for level in range(2, 12)]
    np.testing.assert_allclose(levels, printed, atol=6e-5)


def test_a_record_cut_at_a_sample_starts_from_zero_again():
    part = records.from_sample(records.constant_speed(), 100)
    assert (part.t[0], part.t.size) == (0, 2301)
    with pytest.raises(ValueError, match="start sample 2400"):
        records.from_sample(records.constant_speed(), 2400)


def test_simulated_records_take_the_place_of_the_authors(monkeypatch):
    monkeypatch.setenv("BACKLASH_RECORDS", "simulated")
    clean, noisy = records.load_clean(6), records.load_noisy(6, 2)
    assert "simulated joint" in clean.source
    assert clean.t.size == 2401
    assert (clean.v - 100).max() == pytest.approx(0.72, abs=0.03)  # of the printed 0.7246
    assert np.abs(noisy.v - clean.v).max() <= records.noise_half_amplitude_rps(6)
    with pytest.raises(ValueError, match="K is 1 to 20, R is 1 to 5"):
        records.load_noisy(21, 1)


def test_the_authors_files_are_as_they_say(authors_data):
    clean, noisy = records.load_clean(12), records.load_noisy(2, 1)
    assert clean.t.size == noisy.t.size == 2401
    np.testing.assert_allclose(np.diff(clean.t), 2e-3, atol=1e-9)
    assert set(records.AUTHORS_FILES) <= set(records.authors_checksums())
    # The records repeat after 0.400 s, not after Table 1's 0.408 s: E3.
    settled = clean.v[400:]
    off = {shift: np.std(settled[shift:] - settled[:-shift]) for shift in (200, 204)}
    assert off[200] < 0.02 < 0.2 < off[204]


def test_a_first_row_that_is_no_sample_is_dropped(authors_data):
    assert records.load_noisy(1, 1).t[:2] == pytest.approx([0, 2e-3])
