import functools
import hashlib
import http.server
import os
import threading

import numpy as np
import pytest

from replication import published, records
from replication.public_files import DataCorrupt, DataUnavailable
from replication.records import WORKBOOK_FILES, authors_file, authors_registry
from replication.sources import load_clean, load_noisy

# ------------------------------------------------------------------------------------------- finding and download


FILE = "Noisy data/a file.zip"


@pytest.fixture
def registered(monkeypatch):
    """Register one small file instead of the authors'."""
    content = b"the authors' bytes"
    digest = hashlib.sha256(content).hexdigest()
    monkeypatch.setattr(records, "authors_registry", lambda: {FILE: digest})
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


@pytest.fixture
def local(registered, tmp_path, monkeypatch):
    """Where the local copy of the registered file belongs."""
    (tmp_path / "Noisy data").mkdir()
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    return tmp_path / FILE


def test_a_file_is_downloaded_verified_and_kept(registered, server, tmp_path):
    folder, url = server
    (folder / FILE).write_bytes(registered)
    cache = tmp_path / "cache"
    path = authors_file(FILE, base_url=url, cache=cache)
    assert path.read_bytes() == registered
    (folder / FILE).unlink()
    assert authors_file(FILE, base_url=url, cache=cache) == path


@pytest.mark.parametrize("content", [b"other bytes", b"the authors'"], ids=["wrong", "truncated"])
def test_a_download_with_a_wrong_hash_is_refused_and_leaves_nothing(
    registered, server, tmp_path, content
):
    folder, url = server
    (folder / FILE).write_bytes(content)
    cache = tmp_path / "cache"
    with pytest.raises(DataCorrupt, match=r"a file\.zip.*SHA-256"):
        authors_file(FILE, base_url=url, cache=cache)
    assert [path for path in cache.rglob("*") if path.is_file()] == []


def test_without_a_network_the_file_and_the_way_out_are_named(registered, tmp_path):
    with pytest.raises(DataUnavailable, match=r"a file\.zip.*BACKLASH_DATA") as caught:
        authors_file(FILE, base_url="http://127.0.0.1:9/", cache=tmp_path / "cache")
    assert "\n" not in str(caught.value)


def test_a_local_copy_is_used_where_backlash_data_says(registered, local):
    local.write_bytes(registered)
    assert authors_file(FILE, base_url="http://127.0.0.1:9/") == local


def test_a_pipe_is_refused_and_not_waited_for(local):
    os.mkfifo(local)
    with pytest.raises(DataUnavailable, match=r"a file\.zip: not readable \(a pipe\)"):
        authors_file(FILE)


def test_our_records_take_the_authors_place_if_that_is_said(monkeypatch):
    monkeypatch.setenv("BACKLASH_RECORDS", "simulated")
    clean = load_clean(3)
    first, again = load_noisy(3, 1), load_noisy(3, 1)
    other = load_noisy(3, 2)
    assert "simulated" in first.source
    assert (first.v == again.v).all()
    assert not np.allclose(first.v, other.v)
    assert np.abs(first.v - clean.v).max() <= published.value("table2.row02.noise")


def test_a_changed_local_copy_is_refused(local):
    local.write_bytes(b"changed")
    with pytest.raises(DataCorrupt, match=r"a file\.zip.*SHA-256"):
        authors_file(FILE)


def test_a_file_missing_from_the_local_copy_is_named_and_not_downloaded(local):
    with pytest.raises(DataUnavailable, match=r"a file\.zip.*BACKLASH_DATA"):
        authors_file(FILE)


def test_a_file_that_is_not_registered_is_refused(registered):
    with pytest.raises(DataUnavailable, match="no such file"):
        authors_file("Speeddata99.xlsx")


def test_the_registry_covers_every_file_that_the_workbook_reads():
    registry = authors_registry()
    assert set(WORKBOOK_FILES) <= set(registry)
    assert all(len(digest) == 64 for digest in registry.values())
