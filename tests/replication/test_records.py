"""Records, their noise (equations 18 and 19), and the authors' files: found, verified, or refused in one line."""

import hashlib
import io
import os
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from replication import published, records
from replication.records import (
    AUTHORS_FILES,
    LOW_NOISE,
    DataCorrupt,
    DataUnavailable,
    add_noise,
    authors_checksums,
    constant_speed,
    from_sample,
    level_delta_rad,
    load_clean,
    load_noisy,
    noise_half_amplitude_rps,
    public_file,
    read_worksheet,
)

CONTENT = b"a public file"
SHA256 = hashlib.sha256(CONTENT).hexdigest()


def find(sha256: str = SHA256) -> Path:
    return public_file("http://127.0.0.1:9/x.zip", "a folder/x.zip", sha256, "SOME_DATA")


@pytest.fixture
def local(tmp_path, monkeypatch) -> Path:
    """Where a local copy belongs."""
    monkeypatch.setenv("SOME_DATA", str(tmp_path))
    (tmp_path / "a folder").mkdir()
    return tmp_path / "a folder" / "x.zip"


def test_a_level_has_table_2s_backlash_and_noise():
    levels = range(2, 12)
    deltas = [level_delta_rad(level) for level in levels]
    noise = [noise_half_amplitude_rps(level) for level in levels]
    np.testing.assert_allclose(deltas, np.arange(3e-4, 22e-4, 2e-4), rtol=1e-12)
    np.testing.assert_allclose(noise, published.column("Table 2", "noise")[:10], atol=1e-4)


def test_a_record_from_a_later_sample_starts_at_time_zero():
    record = constant_speed()
    cut = from_sample(record, 10)
    assert (cut.t[0], cut.t[1], cut.t.size) == (0.0, pytest.approx(0.002), 2391)
    assert from_sample(record, 2398).t.size == 3
    with pytest.raises(ValueError, match="start sample 2399"):
        from_sample(record, 2399)


def test_a_record_of_constant_speed_is_twelve_turns_at_100_rps():
    record = constant_speed()
    assert (record.v == 100).all()
    assert record.sample_s == pytest.approx(0.002, rel=1e-12)
    assert record.t[-1] == pytest.approx(12 * record.turn_period_s)


def test_noise_is_uniform_about_zero_and_its_seed_gives_it_again():
    record = constant_speed()
    first, second = (add_noise(record, 0.1, np.random.default_rng(3)).v - 100 for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert stats.kstest(first, stats.uniform(-0.1, 0.2).cdf).pvalue > 0.01


def test_our_records_take_the_authors_place_if_that_is_asked_for(monkeypatch):
    monkeypatch.setenv("BACKLASH_RECORDS", "simulated")
    clean, first, again, other = load_clean(3), load_noisy(3, 1), load_noisy(3, 1), load_noisy(3, 2)
    assert "simulated" in first.source
    np.testing.assert_array_equal(clean.v, clean.v.round(2))
    np.testing.assert_array_equal(first.v, again.v)
    assert not np.allclose(first.v, other.v)
    half = noise_half_amplitude_rps(3)
    assert 0.99 * half < np.abs(first.v - clean.v).max() <= half
    assert {load_noisy(level, R).t.size for level, R in ((1, 1), (20, 5))} == {2401}


@pytest.mark.parametrize(("level", "realisation"), [(3, 6), (3, 0), (21, 1), (0, 1)])
def test_a_noisy_record_that_is_not_public_is_refused_in_one_line(level, realisation):
    with pytest.raises(ValueError, match=rf"^no noisy record K = {level}, R = {realisation}: .*$"):
        load_noisy(level, realisation)


def test_a_worksheet_of_numbers_is_read_as_pandas_reads_it(tmp_path):
    table = np.random.default_rng(1).normal(size=(40, 2)).round(5)
    path = tmp_path / "x.xlsx"
    pd.DataFrame(table).to_excel(path, index=False, header=False, startrow=1)
    np.testing.assert_array_equal(read_worksheet(path), table)
    np.testing.assert_array_equal(read_worksheet(io.BytesIO(path.read_bytes())), table)


# ----------------------------------------------------------------------------- found, verified, refused


def test_a_local_copy_is_verified(local):
    local.write_bytes(CONTENT)
    assert find() == local
    local.write_bytes(CONTENT[:-1])
    with pytest.raises(DataCorrupt, match="SHA-256"):
        find()


@pytest.mark.parametrize("make", [Path.mkdir, os.mkfifo, lambda path: None])
def test_what_is_no_file_in_the_folder_is_named_with_its_variable(local, make):
    make(local)
    with pytest.raises(DataCorrupt, match=r"x\.zip: .* SOME_DATA") as caught:
        find()
    assert "\n" not in str(caught.value)
    assert caught.value.exit_status == 2


def test_without_network_and_copy_the_file_and_the_way_out_are_named(monkeypatch, tmp_path):
    monkeypatch.delenv("SOME_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(DataUnavailable, match=r"x\.zip: .* SOME_DATA") as caught:
        find()
    assert "\n" not in str(caught.value)


def test_every_file_that_is_read_is_registered():
    registered = authors_checksums()
    assert set(AUTHORS_FILES) <= set(registered)
    assert {len(digest) for digest in registered.values()} == {64}
    assert len(AUTHORS_FILES) == 11 + 5


def test_a_table_is_written_with_six_digits_and_json_with_an_indent(tmp_path):
    records.write_csv(tmp_path / "a" / "x.csv", pd.DataFrame({"a": [1 / 3]}))
    records.write_json(tmp_path / "x.json", {"a": 1})
    assert (tmp_path / "a" / "x.csv").read_text() == "a\n0.333333\n"
    assert (tmp_path / "x.json").read_text() == '{\n "a": 1\n}\n'


def test_a_repeated_first_row_is_no_sample(tmp_path, monkeypatch):
    rows = np.array([[0, 99.0], [0, 100.0], [0.002, 101.0], [0.004, 102.0]])
    sheet = io.BytesIO()
    pd.DataFrame(rows).to_excel(sheet, index=False, header=False)
    path = tmp_path / "noisy.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("R/SpeeddataNoise1_7.xlsx", sheet.getvalue())
        archive.writestr("R/SpeeddataNoise11_7.xlsx", b"")
    monkeypatch.setattr(records, "authors_file", lambda name: path)
    record = load_noisy(1, 1)
    assert record.v.tolist() == [100, 101, 102]
    assert (record.t[0], record.commanded_speed_rps, record.turn_period_s) == (0, 100, 0.4)


# ------------------------------------------------------------------------------------ the authors' records


def test_the_clean_records_are_twelve_turns_of_five_significant_digits(authors_data):
    for level in range(3, 14):
        record = load_clean(level)
        np.testing.assert_allclose(record.t, 0.002 * np.arange(2401), atol=1e-9)
        five_digits = np.where(record.v < 100, record.v.round(3), record.v.round(2))
        np.testing.assert_array_equal(record.v, five_digits)


def test_the_authors_noisy_records_differ_and_have_as_many_samples(authors_data):
    loaded = [load_noisy(level, R) for R in LOW_NOISE for level in (1, 2, 11)]
    assert {record.t.size for record in loaded} == {2401}
    assert len({record.v.tobytes() for record in loaded}) == 15


def test_level_1_is_not_free_of_backlash(authors_data):
    assert load_noisy(1, 1).v.std() > 1.2 * 0.1 / np.sqrt(3)
