"""The Makefile's dependencies are what the kernels noted that each notebook read."""

import json
import os
import re
import shutil
import subprocess

import pytest

import workbook
from workbook import provenance, running
from workbook.checkout import RESULTS, notebook_files
from workbook.outcomes import load_outcomes

OUTCOMES = load_outcomes(RESULTS)
READ = {notebook: {*outcome["made_from"]["sources"]} for notebook, outcome in OUTCOMES.items()}
SOURCES = sorted(set.union(*READ.values()))


def readers_of(name):
    """Notebooks that read a file."""
    return {notebook for notebook, names in READ.items() if name in names}


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A copy of the sources in which everything has been made."""
    folder = tmp_path_factory.mktemp("tree")
    for name in {
        *SOURCES,
        "Makefile",
        *(str(path.relative_to(workbook.ROOT)) for path in _notebooks()),
    }:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(workbook.ROOT / name, folder / name)
    (folder / ".venv").mkdir()
    (folder / ".make").mkdir()
    for notebook, names in READ.items():
        rule = running.dependencies(".make", notebook, names)
        (folder / ".make" / f"{notebook}.d").write_text(rule, "utf-8")
    return folder


def _notebooks():
    return list(notebook_files("py").values())


def due(folder, changed=None):
    """Notebooks that `make all` would run after a change of one file."""
    made = [".venv/.installed", *(f".make/{path.stem}.done" for path in _notebooks())]
    for path in folder.rglob("*"):
        os.utime(path, (1e9, 1e9))
    for name in [*made, ".make/workbook.done"]:
        (folder / name).touch()
        os.utime(folder / name, (1.1e9, 1.1e9))
    if changed:
        (folder / changed).touch()
    command = ["make", "--dry-run", "--no-print-directory", "all"]
    said = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout
    return set(re.findall(r"echo notebooks/(?:beyond/)?(\w+)\.py >> ", said))


@pytest.mark.slow
def test_after_a_change_exactly_the_notebooks_run_that_read_the_file(tree):
    assert due(tree) == set()
    read_by_all = set.intersection(*READ.values())
    for name in {*SOURCES} - read_by_all | {"requirements.lock"}:
        assert due(tree, name) == readers_of(name), name


# A stand-in for `python -m workbook` that notes how it is called; a run stamps its notebooks, or fails.
PROGRAM = """echo "$@" >> calls
[ "$1" = run ] || exit 0
[ ! -e failing ] || exit 1
for word in "$@"; do case "$word" in notebooks/*) touch ".make/$(basename "$word" .py).done";; esac; done
"""


def calls(folder):
    """Calls of the program by a real `make all`, and how make ended."""
    (folder / "program").write_text(PROGRAM, "utf-8")
    (folder / "calls").write_text("", "utf-8")
    ended = subprocess.run(
        ["make", "RUN=sh program", "all"], cwd=folder, capture_output=True, text=True, check=False
    )
    said = (folder / "calls").read_text("utf-8").splitlines()
    made = [re.sub(r"--stamps .make --watch \d+ ", "", call) for call in said if call != "free"]
    return made, ended.returncode


def test_a_changed_notebook_is_run_once_and_the_report_made_until_it_succeeds(tree):
    assert due(tree, "notebooks/05_growth_figure11.py") == {"05_growth_figure11"}
    (tree / "failing").touch()
    for _ in range(2):
        (run, *others), status = calls(tree)
        assert run == "run notebooks/05_growth_figure11.py"
        assert "report" in others
        assert status != 0
    (tree / "failing").unlink()
    (run, *_), status = calls(tree)
    assert (run, status) == ("run notebooks/05_growth_figure11.py", 0)
    assert calls(tree) == ([], 0)


def test_a_source_that_is_gone_makes_its_readers_due(tree):
    name = next(name for name in SOURCES if name.startswith("backlash/fitting/"))
    kept = (tree / name).read_bytes()
    (tree / name).unlink()
    assert due(tree) == readers_of(name)
    (tree / name).write_bytes(kept)


def test_every_notebook_has_noted_itself_the_locked_versions_and_the_package():
    assert set(OUTCOMES) == {path.stem for path in _notebooks()}
    for source in _notebooks():
        needed = {
            str(source.relative_to(workbook.ROOT)),
            "requirements.lock",
            "replication/__init__.py",
        }
        assert needed <= READ[source.stem]


def test_results_whose_sources_have_changed_since_are_stale(tmp_path):
    outcome = json.loads((RESULTS / "outcomes" / "02_dead_zone_figure9.json").read_text("utf-8"))
    (tmp_path / "outcomes").mkdir()
    path = tmp_path / "outcomes" / "02_dead_zone_figure9.json"
    path.write_text(json.dumps(outcome), encoding="utf-8")
    assert provenance.stale(tmp_path) == {}
    outcome["made_from"]["sources"]["replication/dead_zone.py"] = "0" * 64
    outcome["made_from"]["sources"]["replication/no_longer.py"] = "0" * 64
    path.write_text(json.dumps(outcome), encoding="utf-8")
    changed = ["replication/dead_zone.py", "replication/no_longer.py"]
    assert provenance.stale(tmp_path) == {"02_dead_zone_figure9": changed}


def test_no_committed_result_is_stale():
    assert provenance.stale(RESULTS) == {}


TARGETS = re.findall(r"^([a-z-]+):.*##", (workbook.ROOT / "Makefile").read_text("utf-8"), re.M)
# Those that take minutes, wait for a user or need a network: only what they would do is asked.
LONG = {"all", "quick", "test", "slow", "changes", "portable", "lab", "lock", "audit", "bench"}


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
