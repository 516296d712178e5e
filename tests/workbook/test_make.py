"""What `make all` runs again: what this checkout has not run yet, and what has changed since."""

import os
import re
import shutil
import subprocess

import pytest

import workbook
from replication.files import write_json, write_text
from workbook import due
from workbook.checkout import RESULTS, notebook_files
from workbook.outcomes import load_outcomes

OUTCOMES = load_outcomes(RESULTS)
READ = {notebook: {*outcome["made_from"]["sources"]} for notebook, outcome in OUTCOMES.items()}
SECOND = "02_dead_zone_figure9"


@pytest.fixture
def digests(monkeypatch):
    """SHA-256 of each source, by name, as the committed outcomes noted it."""
    noted = {}
    for outcome in OUTCOMES.values():
        noted |= outcome["made_from"]["sources"]
    monkeypatch.setattr(due, "_digest", noted.get)
    return noted


@pytest.fixture
def made(digests, tmp_path):
    """A folder with the committed outcomes, as if this checkout had made them."""
    for name, outcome in OUTCOMES.items():
        file = tmp_path / "results" / "outcomes" / f"{name}.json"
        sources = {source: digests[source] for source in outcome["made_from"]["sources"]}
        write_json(file, {"made_from": {"sources": sources}})
        write_text(due.marker(name, tmp_path), "")
    return tmp_path


def due_in(folder):
    return {source.stem for source in due.due(list(_notebooks()), folder)}


def _notebooks():
    return notebook_files("py").values()


def test_in_a_new_checkout_every_notebook_is_due_and_after_its_run_none(made):
    assert due_in(made) == set()
    shutil.rmtree(made / ".make")
    assert due_in(made) == set(READ)


def test_after_a_change_exactly_the_notebooks_are_due_that_read_the_file(made, digests):
    for name, digest in dict(digests).items():
        digests[name] = "0" * 64
        assert due_in(made) == {notebook for notebook, read in READ.items() if name in read}
        digests[name] = digest


# A stand-in for `python -m workbook` that notes how it is called, and ends a run as a file says.
PROGRAM = """echo "$@" >> calls
[ "$1" != run ] || exit $(cat ending)
"""


@pytest.fixture
def make_all(tmp_path):
    """A real `make all` whose run ends with a status; return the calls of the program, and how make ended."""
    shutil.copy(workbook.ROOT / "Makefile", tmp_path)
    (tmp_path / ".venv").mkdir()
    (tmp_path / "requirements.lock").touch()
    (tmp_path / ".venv" / ".installed").touch()
    (tmp_path / "program").write_text(PROGRAM, "utf-8")

    def make(ending):
        (tmp_path / "ending").write_text(str(ending))
        (tmp_path / "calls").write_text("")
        ended = subprocess.run(
            ["make", "RUN=sh program", "all"], cwd=tmp_path, capture_output=True, check=False
        )
        (tmp_path / "results" / "outcomes").mkdir(parents=True, exist_ok=True)
        return [
            call.split()[0] for call in (tmp_path / "calls").read_text().splitlines()
        ], ended.returncode

    return make


REPORT = ["report", "article", "check"]


def test_make_makes_the_report_once_and_ends_badly_while_a_notebook_fails(make_all):
    assert make_all(1) == (["run", *REPORT], 2)
    assert make_all(1) == (["run"], 2)
    assert make_all(0) == (["run"], 0)


@pytest.mark.parametrize("ending", [2, 130])
def test_make_ends_with_a_run_that_is_interrupted_or_locked_out(make_all, ending):
    assert make_all(ending) == (["run"], 2)


def test_every_notebook_has_noted_itself_the_locked_versions_and_the_package():
    assert set(OUTCOMES) == {path.stem for path in _notebooks()}
    for source in _notebooks():
        needed = {
            str(source.relative_to(workbook.ROOT)),
            "requirements.lock",
            "replication/__init__.py",
        }
        assert needed <= READ[source.stem]


def test_results_whose_sources_have_changed_since_are_stale(made, digests):
    assert due.stale(made / "results") == {}
    digests["replication/dead_zone.py"] = "0" * 64
    assert due.stale(made / "results")[SECOND] == ["replication/dead_zone.py"]


def test_no_committed_result_is_stale():
    assert due.stale(RESULTS) == {}


TARGETS = re.findall(r"^([a-z-]+):.*##", (workbook.ROOT / "Makefile").read_text("utf-8"), re.M)
# Those that take minutes, wait for a user or need a network: only what they would do is asked.
LONG = {
    "all",
    "run",
    "quick",
    "test",
    "slow",
    "changes",
    "portable",
    "lab",
    "lock",
    "audit",
    "bench",
}


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS)
def test_every_target_can_be_the_first_command_in_a_clone(target, authors_data, tmp_path):
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "--quiet", workbook.ROOT, clone], check=True)
    (clone / ".venv").symlink_to(workbook.ROOT / ".venv")
    os.utime(clone / "requirements.lock", (1e9, 1e9))
    options = ["--dry-run"] if target in LONG else []
    ran = subprocess.run(["make", *options, target], cwd=clone, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
