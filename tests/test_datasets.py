import functools
import hashlib
import http.server
import io
import threading
import zipfile

import numpy as np
import openpyxl
import pytest

from replication import datasets, inspection, published, table2
from replication.data.authors import (
    WORKBOOK_FILES,
    DataCorrupt,
    DataUnavailable,
    authors_file,
    authors_registry,
    parse_speed_workbook,
    read_zip_member,
)


def workbook_bytes(rows):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    buffer = io.BytesIO()
    book.save(buffer)
    return buffer.getvalue()


GOOD_ROWS = [(0.002 * k, 100.0 + k) for k in range(5)]


def test_a_blank_first_row_is_dropped():
    t, v = parse_speed_workbook(workbook_bytes([(None, None), *GOOD_ROWS]), "file")
    np.testing.assert_allclose(t, [0, 0.002, 0.004, 0.006, 0.008])
    np.testing.assert_allclose(v, [100, 101, 102, 103, 104])


def test_a_first_row_with_the_time_of_the_second_is_dropped():
    t, v = parse_speed_workbook(workbook_bytes([(0.0, 98.5), *GOOD_ROWS]), "file")
    assert (t[0], v[0], t.size) == (0.0, 100.0, 5)


@pytest.mark.parametrize(
    "rows",
    [
        [],
        GOOD_ROWS[:2],
        [*GOOD_ROWS, ("text", 1.0)],
        [*GOOD_ROWS, (0.010, None)],
        [*GOOD_ROWS, (0.002, 100.0)],
        [(*row, 1.0) for row in GOOD_ROWS],
        [*GOOD_ROWS, (0.020, 100.0)],
    ],
    ids=["empty", "two rows", "text", "gap in a row", "backwards", "three columns", "uneven"],
)
def test_a_bad_table_is_refused_by_name(rows):
    with pytest.raises(DataCorrupt, match="this file"):
        parse_speed_workbook(workbook_bytes(rows), "this file")


def test_bytes_that_are_no_workbook_are_refused():
    with pytest.raises(DataCorrupt, match="not a workbook"):
        parse_speed_workbook(b"no workbook", "this file")


# ------------------------------------------------------------------------------------------- finding and download


@pytest.fixture
def registered(monkeypatch):
    """Register one small file instead of the authors'."""
    content = b"the authors' bytes"
    digest = hashlib.sha256(content).hexdigest()
    monkeypatch.setattr(datasets, "authors_registry", lambda: {"Noisy data/a file.zip": digest})
    monkeypatch.delenv("BACKLASH_DATA", raising=False)
    return content


@pytest.fixture
def server(tmp_path):
    """Serve a folder on the loopback; yields the folder and its address."""
    folder = tmp_path / "served"
    (folder / "Noisy data").mkdir(parents=True)
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
    handler.log_message = lambda *_: None
    httpd = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=httpd.serve_forever, daemon=True)
    thread.start()
    yield folder, f"http://127.0.0.1:{httpd.server_port}/"
    httpd.shutdown()
    httpd.server_close()


def test_a_file_is_downloaded_verified_and_kept(registered, server, tmp_path):
    folder, url = server
    (folder / "Noisy data" / "a file.zip").write_bytes(registered)
    cache = tmp_path / "cache"
    path = authors_file("Noisy data/a file.zip", base_url=url, cache=cache)
    assert path.read_bytes() == registered
    (folder / "Noisy data" / "a file.zip").unlink()
    assert authors_file("Noisy data/a file.zip", base_url=url, cache=cache) == path


@pytest.mark.parametrize("content", [b"other bytes", b"the authors'"], ids=["wrong", "truncated"])
def test_a_download_with_a_wrong_hash_is_refused_and_leaves_nothing(registered, server, tmp_path, content):
    folder, url = server
    (folder / "Noisy data" / "a file.zip").write_bytes(content)
    cache = tmp_path / "cache"
    with pytest.raises(DataCorrupt, match=r"a file\.zip.*SHA-256"):
        authors_file("Noisy data/a file.zip", base_url=url, cache=cache)
    assert [path for path in cache.rglob("*") if path.is_file()] == []


def test_a_file_that_the_server_does_not_have_is_named(registered, server, tmp_path):
    cache = tmp_path / "cache"
    with pytest.raises(DataUnavailable, match=r"a file\.zip.*cannot be downloaded"):
        authors_file("Noisy data/a file.zip", base_url=server[1], cache=cache)
    assert [path for path in cache.rglob("*") if path.is_file()] == []


def test_without_a_network_the_file_and_the_way_out_are_named(registered, tmp_path):
    with pytest.raises(DataUnavailable, match=r"a file\.zip.*BACKLASH_DATA") as caught:
        authors_file("Noisy data/a file.zip", base_url="http://127.0.0.1:9/", cache=tmp_path / "cache")
    assert "\n" not in str(caught.value)


def test_a_local_copy_is_used_where_backlash_data_says(registered, tmp_path, monkeypatch):
    (tmp_path / "Noisy data").mkdir()
    file = tmp_path / "Noisy data" / "a file.zip"
    file.write_bytes(registered)
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    assert authors_file("Noisy data/a file.zip", base_url="http://127.0.0.1:9/") == file


def test_a_changed_local_copy_is_refused(registered, tmp_path, monkeypatch):
    (tmp_path / "Noisy data").mkdir()
    (tmp_path / "Noisy data" / "a file.zip").write_bytes(b"changed")
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    with pytest.raises(DataCorrupt, match=r"a file\.zip.*SHA-256"):
        authors_file("Noisy data/a file.zip")


def test_a_file_missing_from_the_local_copy_is_named_and_not_downloaded(registered, tmp_path, monkeypatch):
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    with pytest.raises(DataUnavailable, match=r"a file\.zip.*BACKLASH_DATA"):
        authors_file("Noisy data/a file.zip")


def test_a_file_that_is_not_registered_is_refused(registered):
    with pytest.raises(DataUnavailable, match="no such file"):
        authors_file("Speeddata99.xlsx")


def test_a_truncated_archive_is_named(tmp_path):
    archive = tmp_path / "bundle.zip"
    with zipfile.ZipFile(archive, "w") as bundle:
        bundle.writestr("SpeeddataNoise1.xlsx", b"x" * 1000)
    archive.write_bytes(archive.read_bytes()[:-30])
    with pytest.raises(DataCorrupt, match=r"bundle\.zip"):
        read_zip_member(archive, ".*")


def test_an_archive_without_the_record_is_named(tmp_path):
    archive = tmp_path / "bundle.zip"
    with zipfile.ZipFile(archive, "w") as bundle:
        bundle.writestr("other.txt", b"x")
    with pytest.raises(DataCorrupt, match=r"bundle\.zip: 0 members"):
        read_zip_member(archive, r".*\.xlsx")


def test_the_registry_covers_every_file_that_the_workbook_reads():
    registry = authors_registry()
    assert set(WORKBOOK_FILES) <= set(registry)
    assert all(len(digest) == 64 for digest in registry.values())


# ------------------------------------------------------------------------------------------------ the records


def test_a_record_from_a_later_sample_starts_at_time_zero():
    record = datasets.constant_speed(samples=50, dt=0.002)
    cut = datasets.from_sample(record, 10)
    assert (cut.t[0], cut.t.size) == (0.0, 40)
    with pytest.raises(ValueError, match="start sample 48"):
        datasets.from_sample(record, 48)


def test_added_noise_is_reproducible_and_bounded():
    record = datasets.constant_speed(samples=500, dt=0.002)
    first, second = (datasets.add_uniform_noise(record, 0.1, np.random.default_rng(3)).v for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert 0.099 < np.abs(first - 100).max() <= 0.1


def test_the_clean_records_are_twelve_turns_of_five_significant_digits(authors_data):
    for level in range(3, 14):
        record = datasets.load_clean(level)
        assert record.t.size == 2401
        assert inspection.whole_turns(record) == published.value("text.turns")
        five_digits = np.where(record.v < 100, record.v.round(3), record.v.round(2))
        np.testing.assert_array_equal(record.v, five_digits)


def test_the_one_bad_first_row_is_dropped(authors_data):
    record = datasets.load_noisy(1, 1)
    assert record.t.size == 2401
    assert np.diff(record.t[:3]) == pytest.approx([0.002, 0.002])
    assert abs(record.v[0] - 100) < 0.2


def test_the_turn_period_in_the_data_is_0_4_s(authors_data):
    for level in (3, 8, 13):
        period = inspection.turn_period(datasets.load_clean(level))
        assert period == pytest.approx(0.400, abs=2e-4)
        assert abs(period - published.value("table1.T_f.max")) > 10 * published.tolerance("table1.T_f.max")


def test_the_turn_period_of_a_made_record_is_found_to_a_tenth_of_a_sample():
    t = 0.002 * np.arange(2401)
    record = datasets.Recording(t, 100 + np.sin(2 * np.pi * t / 0.4137), 100.0, 0.4, "made")
    assert inspection.turn_period(record) == pytest.approx(0.4137, abs=2e-4)


def test_the_added_noise_is_uniform_with_the_printed_half_amplitude(authors_data):
    printed = published.column("Table 2", "noise")
    for row, level in enumerate(table2.table2_levels()):
        formula = 0.1 + (level - 1) * 0.15 / 19
        assert abs(formula - printed[row]) <= 1e-4
        if level >= 3:
            law = inspection.uniform_noise_test(level, 1)
            assert law["p_uniform"] > 0.01
            assert abs(law["mean_over_standard_error"]) < 3
            assert np.ptp(inspection.added_noise(level, 1)) / 2 == pytest.approx(formula, rel=0.005)


def test_the_added_noise_is_not_gaussian(authors_data):
    for level in range(3, 12):
        assert inspection.uniform_noise_test(level, 1)["p_normal"] < 1e-3


def test_level_1_is_not_free_of_backlash(authors_data):
    record = datasets.load_noisy(1, 1)
    only_noise = 0.1 / np.sqrt(3)
    assert record.v.std() > 1.2 * only_noise


def test_the_first_negative_impact_is_a_start_up_transient(authors_data):
    record = datasets.load_clean(10)
    turns = record.v[:2400].reshape(12, 200).min(axis=1) - record.commanded_speed_rps
    assert turns[0] < 1.1 * turns[1:].min()
    assert np.ptp(turns[1:]) < 0.02 * abs(turns[1:].mean())


def test_a_level_below_the_published_ones_is_refused(authors_data):
    with pytest.raises(DataUnavailable, match=r"Speeddata2\.xlsx"):
        datasets.load_clean(2)
