"""A certificate says what ran here, and names each file that is not as it is committed."""

import subprocess
from unittest.mock import Mock

import pytest

from replication import records
from replication.files import DataUnavailable, UserError
from workbook import certificate, stamps
from workbook.sources import listed_exports

FIGURE = "figures/one.svg"


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A clone of one notebook, which has run here, with what it made committed."""
    source = tmp_path / "notebooks" / "01_small.py"
    source.parent.mkdir()
    source.write_text('workbook.show_figure("one", figure, "A figure.")\n')
    others = ("README.md", "results/kept.csv", "results/report.md", "results/verdicts.csv")
    made = [tmp_path / name for name in (*listed_exports(source), *others)]
    for file in made:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(file.name)
    (tmp_path / ".gitignore").write_text(".make\n")
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    for words in (["init", "-q"], ["add", "-A"], [*who, "commit", "-q", "-m", "made"]):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)
    (tmp_path / ".make").mkdir()
    (tmp_path / ".make" / "01_small.ran").write_bytes(stamps.new_stamp(tmp_path, made, 12))
    monkeypatch.setattr(certificate, "ROOT", tmp_path)
    monkeypatch.setattr(certificate, "notebook_sources", lambda: {"01_small": source})
    return tmp_path


def test_a_rerun_to_the_same_bytes_is_certified_but_for_the_data_that_are_not_there(clone):
    about = certificate.certify()
    lines = certificate.find_differences(about)
    assert len(about["commit"]) == 40
    assert about["changed"] == []
    assert about["notebooks"]["01_small"] == {"ran_here": True, "seconds": 12, "changed_since": []}
    assert all(line.startswith("authors' files: ") for line in lines)
    page = certificate.write_certificate(about)
    assert "| notebooks that ran here | 1 of 1, 12 s |" in page
    assert "as committed | 8 of 8 |" in page


@pytest.mark.parametrize("name", [FIGURE, "results/kept.csv", "notebooks/01_small.ipynb"])
def test_a_byte_that_changes_is_named(clone, name):
    (clone / name).write_text((clone / name).read_text() + " ")
    about = certificate.certify()
    assert about["changed"] == [name]
    assert about["notebooks"]["01_small"]["changed_since"] == [name]
    assert f"{name}: not as committed" in certificate.find_differences(about)
    assert f"- {name}: not as committed\n" in certificate.write_certificate(about)


def test_a_notebook_that_was_removed_is_named(clone, monkeypatch):
    other = clone / "notebooks" / "02_other.py"
    other.touch()
    subprocess.run(["git", "add", other], cwd=clone, check=True)
    other.unlink()
    assert "notebooks/02_other.py: not as committed" in certificate.find_differences(
        certificate.certify()
    )


def test_a_notebook_that_did_not_run_is_named_and_where_none_ran_nothing_is_certified(
    clone, monkeypatch
):
    sources = certificate.notebook_sources()
    other = clone / "notebooks" / "02_other.py"
    other.touch()
    (clone / "notebooks" / "02_other.ipynb").touch()
    monkeypatch.setattr(certificate, "notebook_sources", lambda: sources | {"02_other": other})
    assert "02_other: not run here" in certificate.find_differences(certificate.certify())
    (clone / ".make" / "01_small.ran").unlink()
    with pytest.raises(UserError, match="no notebook was run here"):
        certificate.certify()


def test_data_that_could_not_be_had_are_one_line_and_a_changed_file_is_named(
    clone, monkeypatch, tmp_path
):
    missing = Mock(side_effect=DataUnavailable("no network"))
    monkeypatch.setattr(certificate, "authors_file", missing)
    assert certificate.find_differences(certificate.certify()) == ["authors' files: no network"]
    assert missing.call_count == 1
    (tmp_path / certificate.AUTHORS_FILES[0]).write_text("other")
    monkeypatch.setattr(certificate, "authors_file", records.authors_file)
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    first = certificate.find_differences(certificate.certify())[0]
    assert certificate.AUTHORS_FILES[0] in first
    assert "not the registered one" in first
