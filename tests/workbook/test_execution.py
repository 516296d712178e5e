"""A notebook in a kernel: what it leaves, what is said when it fails, and that nothing stays when a run is killed."""

import os
import re
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import time
from unittest.mock import Mock

import joblib
import nbformat
import psutil
import pytest

from replication.files import UserError, write_files, write_text
from workbook import ROOT, execution, stamps

GOOD = """# %% tags=["parameters"]
repeats = 30

# %%
import matplotlib
import pandas as pd
import workbook
table = pd.DataFrame({"repeats": [repeats]})
workbook.verdict("Thirty.", cells={"text.runs": repeats}, tables={"small": table})
print(matplotlib.rcParams["font.family"])
"""
NAME = "01_small"
LEFT = [f"notebooks/{NAME}.ipynb", f"results/outcomes/{NAME}.json", "results/small.csv"]


@pytest.fixture
def without_kernel(monkeypatch):
    """Execute cells in this process, where what is tested is not the kernel, which takes long to start."""

    def execute(notebook, source, partial):
        exec("\n".join(cell.source for cell in notebook.cells), {})

    monkeypatch.setattr(execution, "execute", execute)


def made_in(folder):
    """What lies in a project but sources and what is never committed, by name."""
    files = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*.*"))}
    return {
        name: path.read_bytes()
        for name, path in files.items()
        if path.is_file() and re.fullmatch(r"[^.].*\.(csv|ipynb|json)", name)
    }


def small(folder):
    return folder / "notebooks" / f"{NAME}.py"


def run(folder):
    return execution.run(small(folder))


@pytest.mark.slow
def test_a_run_leaves_the_same_bytes_each_time_whatever_a_users_settings(
    project, tmp_path, monkeypatch
):
    folder = project(**{NAME: GOOD})
    run(folder)
    first = made_in(folder)
    assert list(first) == LEFT
    assert (folder / ".make" / f"{NAME}.ran").exists()
    assert b"['sans-serif']" in first[LEFT[0]]
    home = tmp_path.parent / "home"
    for name, text in {
        ".config/matplotlib/matplotlibrc": "font.family: serif\n",
        ".ipython/profile_default/startup/0.py": "print('of the profile')\n",
        "startup.py": "print('at the start')\n",
    }.items():
        write_text(home / name, text)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("PYTHONSTARTUP", str(home / "startup.py"))
    monkeypatch.setenv("MATPLOTLIBRC", str(home / ".config/matplotlib"))
    run(folder)
    assert made_in(folder) == first


# It leaves a result before it fails.
FAILS = """# %%
import os, time
from pathlib import Path
results = Path(os.environ["REPLICATION_OUT"], "results")
results.mkdir()
(results / "small.csv").write_text("repeats\\n30\\n")

# %%
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ending", "says"),
    [
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("time.sleep(60)", "A cell timed out while it was being executed, after 2 seconds.;"),
        ("os.kill(os.getpid(), 9)", "the kernel died: killed, out of memory, or a crash "),
        ("import warnings\nwarnings.warn('old')", "it says on stderr: .*UserWarning: old"),
        ("os.system('echo some words >&2')", "it says on stderr: some words;"),
        (
            "import logging\nlogging.getLogger('matplotlib.font_manager').warning('no such font')",
            "it says on stderr: no such font;",
        ),
        ("for k in range(9): print('x' * 2**17)", "it says on stderr: more than .* are printed"),
    ],
)
def test_a_notebook_that_fails_is_named_in_one_line_and_leaves_the_last_results(
    project, ending, says, monkeypatch
):
    folder = project(**{NAME: f"{FAILS}{ending}\n"})
    (folder / "results" / "small.csv").write_text("repeats\n99\n", "utf-8")
    before = made_in(folder)
    monkeypatch.setattr(execution, "CELL_TIMEOUT_S", 2)
    monkeypatch.delenv("PYTEST_CURRENT_TEST", raising=False)  # under which a kernel catches less
    says = rf"^{NAME}\.py, code cell 2: {says}.*$"
    with pytest.raises(execution.NotebookFailed, match=says):
        run(folder)
    assert made_in(folder) == before
    assert not (folder / ".make" / f"{NAME}.ran").exists()


@pytest.fixture
def edited(without_kernel, project):
    """A project whose executed notebook was edited after its run."""
    folder = project(**{NAME: '# %% tags=["parameters"]\nrepeats = 30\n'})
    run(folder)
    small(folder).write_text('# %% tags=["parameters"]\nrepeats = 31\n', "utf-8")
    run(folder)  # a change of the source alone
    notebook = nbformat.read(folder / LEFT[0], as_version=4)
    notebook.cells[0].source = "repeats = 32"
    nbformat.write(notebook, folder / LEFT[0])
    return folder


@pytest.mark.parametrize("newer", [f"{NAME}.py", f"{NAME}.ipynb"])
def test_an_executed_notebook_that_was_edited_is_kept_and_the_advice_takes_the_edits_over(
    edited, newer
):
    shutil.copy(ROOT / "pyproject.toml", edited)
    os.utime(edited / "notebooks" / newer, (2**32, 2**32))
    before = made_in(edited)
    with pytest.raises(UserError, match=r"01_small\.ipynb: edited, and left as it is") as refused:
        run(edited)
    assert made_in(edited) == before
    advised = shlex.split(re.search(r"(\.venv/bin/jupytext .*) takes", str(refused.value))[1])
    subprocess.run([ROOT / advised[0], *advised[1:]], cwd=edited, check=True, capture_output=True)
    assert 'tags=["parameters"]\nrepeats = 32\n' in small(edited).read_text("utf-8")
    run(edited)
    assert b"repeats = 32" in made_in(edited)[LEFT[0]]


DAMAGED = {
    "truncated": ("ipynb", b'{"cells": [{"cell_type": "code", "source": ["repe', "delete it"),
    "another JSON": ("ipynb", b"[1, 2]", "delete it"),
    "not in UTF-8": ("py", "# %%\nname = 'größer'\n".encode("latin-1"), "correct it"),
}


@pytest.mark.parametrize(("kind", "content", "advice"), DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_notebook_is_named_in_one_line_and_left_as_it_is(project, kind, content, advice):
    file = project(**{NAME: "# %%\nrepeats = 30\n"}) / "notebooks" / f"{NAME}.{kind}"
    file.write_bytes(content)
    with pytest.raises(UserError, match=rf"^.*{NAME}\.{kind}: no notebook .*; {advice}.*$"):
        execution.run(file.with_suffix(".py"))
    assert file.read_bytes() == content


def test_where_one_place_cannot_be_written_nothing_is_put_in_place(project):
    folder = project(**{NAME: FAILS})
    (folder / "results" / "small.csv").mkdir()
    with pytest.raises(OSError, match="results/small"):
        run(folder)
    assert made_in(folder) == {}
    assert not list(folder.rglob("*.tmp"))


def test_files_are_written_all_or_none_and_what_stands_in_the_way_is_named(tmp_path):
    good, last = tmp_path / "good.txt", tmp_path / "last.txt"
    good.write_bytes(b"old")
    last.mkdir()
    with pytest.raises(OSError, match=r"a folder stands in the place of: .*last\.txt"):
        write_files({good: b"new", last: b"new"})
    last.rmdir()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))  # as a full disk
    try:
        with pytest.raises(OSError, match=r"last\.txt"):
            write_files({good: b"new", last: bytes(2000)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [*tmp_path.iterdir()] == [good]
    assert good.read_bytes() == b"old"


def test_a_file_that_is_replaced_keeps_its_mode(tmp_path):
    file = tmp_path / "shared.csv"
    file.touch()
    file.chmod(0o604)  # which no usual mask of a user's gives
    write_files({file: b"new"})
    assert file.stat().st_mode & 0o777 == 0o604


# --------------------------------------------------------------------------------------------------- without data


NEEDS = """# %%
import os
class DataUnavailable(Exception): pass
if os.environ["BACKLASH_RECORDS"] not in {}: raise DataUnavailable("Speeddata3.xlsx: where?")
"""


@pytest.mark.slow
def test_without_the_authors_files_a_notebook_runs_on_our_records_apart_or_not_at_all(project):
    folder = project(**{NAME: NEEDS.format(["simulated"])})
    assert "on our simulated records" in run(folder)
    assert not {*LEFT} & {*made_in(folder)}
    assert b"our simulated records" in made_in(folder)[f"results/offline/{LEFT[0]}"]
    folder = project(**{NAME: NEEDS.format([])})
    assert "01_small: not run: Speeddata3.xlsx" in run(folder)
    assert stamps.find_why_due(NAME) == "not run: Speeddata3.xlsx: where?"


@pytest.mark.parametrize("name", [f"{NAME}.ipynb", "missing.py"])
def test_what_is_no_source_of_a_notebook_is_refused(project, name):
    folder = project(**{NAME: GOOD})
    with pytest.raises(UserError, match=r"give the \.py source of a notebook"):
        execution.run(folder / "notebooks" / name)


@pytest.mark.parametrize(
    ("cores", "memory", "limit", "workers"),
    [(1, 2**40, "max", 1), (4, 2**40, "max", 2), (16, 2**32, "max", 4), (16, 2**40, f"{2**31}", 2)],
)
def test_two_notebooks_share_the_cores_and_the_memory(
    cores, memory, limit, workers, tmp_path, monkeypatch
):
    (tmp_path / "limit").write_text(f"{limit}\n")
    monkeypatch.setattr(execution, "MEMORY_LIMIT", tmp_path / "limit")
    monkeypatch.setattr(joblib, "cpu_count", lambda: cores)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: Mock(available=memory))
    assert execution.count_workers() == workers


# ------------------------------------------------------------------------------------------------ runs that are ended

LONG = """# %%
import os, time
from pathlib import Path
from joblib import Parallel, delayed
def work():
    with open({pids!r}, "a") as file:
        file.write(f"{{os.getpid()}} ")
    time.sleep(100)
work_here = open({pids!r}, "a").write(f"{{os.getpid()}} ")
Parallel(2)([delayed(work)()] * 2)
"""


def wait_until(condition, seconds):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.1)


@pytest.fixture
def long(project, tmp_path):
    """A project of a notebook that ends and one that does not; and what finds the ids of the latter's processes."""
    pids = tmp_path / "pids.txt"
    folder = project(**{NAME: GOOD, "02_long": LONG.format(pids=str(pids))})
    pids.touch()
    return folder, lambda: {*map(int, pids.read_text().split())}


@pytest.mark.slow
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_says_one_line_and_leaves_no_kernel(long, ending):
    folder, find_pids = long
    running = subprocess.Popen(
        [sys.executable, "-m", "workbook", "run", "notebooks/02_long.py"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_until(lambda: len(find_pids()) == 3, 100)
    running.send_signal(ending)
    _, said = running.communicate(timeout=60)
    assert said.count("\n") == (ending == signal.SIGINT)
    assert running.returncode == (130 if ending == signal.SIGINT else -ending)
    wait_until(lambda: not find_pids().intersection(psutil.pids()), 10)


@pytest.mark.slow
def test_a_killed_make_leaves_no_process_and_no_half_file_and_the_next_one_goes_on(long):
    folder, find_pids = long
    make = start_make(folder)
    wait_until(lambda: len(find_pids()) == 3, 100)
    wait_until((folder / ".make" / f"{NAME}.ran").exists, 100)
    started = {process.pid for process in psutil.Process(make.pid).children(recursive=True)}
    make.kill()
    make.wait()
    wait_until(lambda: not (started | find_pids()).intersection(psutil.pids()), 10)
    assert [name for name in LEFT if name in made_in(folder)] == LEFT
    assert not (folder / "notebooks" / "02_long.ipynb").exists()
    for source, status in (("1 / 0", 2), ("print(1)", 0)):
        (folder / "notebooks" / "02_long.py").write_text(f"# %%\n{source}\n", "utf-8")
        assert start_make(folder).wait(100) == status
    assert (folder / "notebooks" / "02_long.ipynb").exists()


def start_make(folder):
    """Start `make all` of our Makefile on another project, which has no report."""
    shutil.copy(ROOT / "Makefile", folder)
    (folder / ".venv").mkdir(exist_ok=True)
    (folder / ".venv" / ".installed").touch()
    machine = f"PYTHONPATH={shlex.quote(str(ROOT))} {shlex.quote(sys.executable)} -m workbook"
    (folder / "run.sh").write_text(f'test "$1" = report || exec env {machine} "$@"\n')
    command = ["make", "all", "RUN=sh run.sh"]
    return subprocess.Popen(command, cwd=folder, stderr=subprocess.DEVNULL)
