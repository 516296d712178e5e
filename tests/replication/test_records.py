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
from scipy.interpolate import CubicSpline

from replication import published, records
from replication.files import DataCorrupt, DataUnavailable
from replication.joint import identified_joint, simulate
from replication.records import (
    CLEAN_LEVELS,
    LOW_NOISE,
    add_noise,
    constant_speed,
    level_delta_rad,
    load_clean,
    load_noisy,
    needed_checksums,
    noise_half_amplitude_rps,
    public_file,
)
from tests.made import TIME

CONTENT = b"a public file"
SHA256 = hashlib.sha256(CONTENT).hexdigest()


def find(host="http://127.0.0.1:9") -> Path:
    return public_file(f"{host}/x.zip", "a folder/x.zip", SHA256, "SOME_DATA")


@pytest.fixture
def local(tmp_path, monkeypatch) -> Path:
    """Where a local copy belongs."""
    monkeypatch.setenv("SOME_DATA", str(tmp_path))
    (tmp_path / "a folder").mkdir()
    return tmp_path / "a folder" / "x.zip"


def test_a_record_of_constant_speed_is_twelve_turns_at_100_rps_and_its_noise_is_uniform_about_zero():
    record = constant_speed()
    assert (record.v == 100).all()
    assert record.sample_s == pytest.approx(0.002, rel=1e-12)
    assert record.t[-1] == pytest.approx(12 * record.turn_period_s)
    first, second = (add_noise(record, 0.1, np.random.default_rng(3)).v - 100 for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert stats.kstest(first, stats.uniform(-0.1, 0.2).cdf).pvalue > 0.01


def test_a_clean_record_that_is_not_public_is_refused():
    for level in (2, 14):
        with pytest.raises(ValueError, match=f"no clean record K = {level} is public"):
            load_clean(level)


def test_our_records_take_the_authors_place_if_that_is_asked_for(monkeypatch):
    monkeypatch.setenv("BACKLASH_RECORDS", "simulated")
    clean, first, again, other = load_clean(3), load_noisy(3, 1), load_noisy(3, 1), load_noisy(3, 2)
    assert "simulated" in first.source
    np.testing.assert_array_equal(clean.v, clean.v.round(2))
    np.testing.assert_array_equal(first.v, again.v)
    assert not np.allclose(first.v, other.v)
    assert np.abs(first.v - clean.v).max() == pytest.approx(noise_half_amplitude_rps(3), rel=0.01)
    assert {load_noisy(level, R).t.size for level, R in ((1, 1), (20, 5))} == {2401}
    for level, R in ((3, 6), (3, 0), (21, 1), (0, 1)):
        with pytest.raises(ValueError, match=f"no noisy record K = {level}, R = {R}"):
            load_noisy(level, R)


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
    with pytest.raises(DataCorrupt, match=r"x\.zip: .* SOME_DATA\b") as refused:
        find()
    assert refused.value.exit_status == 2


CAUSES = {
    "a SOCKS proxy": ("http_proxy", "socks5://127.0.0.1:9", "SOCKS"),
    "a proxy that refuses": ("http_proxy", "http://127.0.0.1:9", "proxy|refused"),
    "no certificates": ("REQUESTS_CA_BUNDLE", "/nowhere/ca.pem", "/nowhere/ca.pem"),
    "no cache": ("XDG_CACHE_HOME", "/dev/null", "/dev/null"),
}


@pytest.mark.parametrize(("variable", "value", "cause"), CAUSES.values(), ids=CAUSES)
def test_a_download_that_fails_names_its_true_cause(variable, value, cause, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for proxy in ("http_proxy", "HTTP_PROXY", "https_proxy", "HTTPS_PROXY"):
        monkeypatch.delenv(proxy, raising=False)
    monkeypatch.setenv(variable, value)
    scheme = "https" if variable == "REQUESTS_CA_BUNDLE" else "http"
    says = rf"(?i)^a folder/x\.zip: not downloaded.*({cause}).* SOME_DATA\b"
    with pytest.raises(DataUnavailable, match=says) as refused:
        find(f"{scheme}://example.invalid")
    assert "\n" not in str(refused.value)


def test_every_file_that_is_read_is_registered():
    assert len(needed_checksums()) == 11 + 5


def test_a_worksheet_is_read_as_pandas_writes_it_but_for_a_repeated_first_row(
    tmp_path, monkeypatch
):
    rows = np.array([[0, 99.0], [0, 100.0], [0.002, 101.12345], [0.004, 102.0]])
    sheet = io.BytesIO()
    pd.DataFrame(rows).to_excel(sheet, index=False, header=False, startrow=1)
    path = tmp_path / "noisy.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("R/SpeeddataNoise1_7.xlsx", sheet.getvalue())
        archive.writestr("R/SpeeddataNoise11_7.xlsx", b"")
    monkeypatch.setattr(records, "authors_file", lambda name: path)
    record = load_noisy(1, 1)
    np.testing.assert_array_equal([record.t, record.v], rows[1:].T)
    assert (record.commanded_speed_rps, record.turn_period_s) == (100, 0.4)


# ------------------------------------------------------------------------------------ the authors' records


def test_the_authors_clean_records_are_twelve_turns_of_five_significant_digits(authors_data):
    for level in CLEAN_LEVELS:
        record = load_clean(level)
        np.testing.assert_allclose(record.t, TIME, atol=1e-9)
        five_digits = np.where(record.v < 100, record.v.round(3), record.v.round(2))
        np.testing.assert_array_equal(record.v, five_digits)


def test_the_one_bad_first_row_is_dropped(authors_data):
    noisy = [load_noisy(level, R) for R in LOW_NOISE for level in (1, 11)]
    for record in noisy:
        np.testing.assert_allclose(record.t, TIME, atol=1e-9)
    assert len({record.v.tobytes() for record in noisy}) == 10
    assert noisy[0].v.std() > 1.2 * 0.1 / np.sqrt(3)  # level 1 is not free of backlash


def test_the_turn_period_in_the_data_is_400_ms(authors_data):
    for level in (3, 8, 13):
        v = load_clean(level).v[200:]  # without the start-up transient
        off = {lag: np.sqrt(np.mean((v[lag:] - v[:-lag]) ** 2)) for lag in range(190, 211)}
        assert min(off, key=off.get) == 200
        assert off[204] > 5 * off[200]  # samples of 2 ms: the printed 0.408 s


def test_the_added_noise_is_not_gaussian(authors_data):
    for level in range(3, 12):
        noise = load_noisy(level, 1).v - load_clean(level).v
        assert stats.normaltest(noise).pvalue < 1e-6
        half = published.value(f"table2.row{level - 1:02d}.noise")
        assert np.ptp(noise) / 2 == pytest.approx(half, rel=0.005)
        assert stats.kstest(noise, stats.uniform(-half, 2 * half).cdf).pvalue > 0.001


def test_the_peak_between_samples_is_known_to_2_percent_and_not_on_one_side():
    """On our joint, sampled at 40 phases: what the tolerance of Table 2's theoretical A in `cells.csv` says."""
    errors = []
    for level in range(3, 12):
        v = simulate(identified_joint(), level_delta_rad(level), sample=5e-5, step=5e-5).v[8000:]
        settled = [v[phase::40].round(2)[:2000] for phase in range(40)]
        fine = np.arange(0, 1999, 1 / 40)
        splines = [CubicSpline(np.arange(2000), each) for each in settled]
        above = np.array([spline(fine).max() for spline in splines]) - 100
        errors.append(100 * (above / (v.max() - 100) - 1))
    assert np.mean(errors) == pytest.approx(0, abs=0.1)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.6, abs=0.05)
    assert np.mean(np.abs(errors) > 2.5) == pytest.approx(0.09, abs=0.01)
