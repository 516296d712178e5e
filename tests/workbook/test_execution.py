"""A notebook in a kernel: what it leaves, what is said when it fails, and that nothing stays when a run is killed."""

import os
import shutil
import subprocess
import sys
import time

import nbformat
import psutil
import pytest

from replication.files import UserError
from workbook import ROOT, execution

GOOD = """# %% tags=["parameters"]
repeats = 30

# %%
import sys
import matplotlib
import pandas as pd
import workbook
table = pd.DataFrame({"repeats": [repeats]})
workbook.verdict("Thirty.", cells={"text.runs": repeats}, tables={"small": table})
print("a bar of progress", file=sys.stderr)
print(matplotlib.rcParams["font.family"])
"""
LEFT = ["notebooks/small.ipynb", "results/outcomes/small.json", "results/small.csv"]


def made_in(folder):
    """What lies in a project but sources and what is never committed, by name."""
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*.*")}
    return {
        name: path.read_bytes()
        for name, path in sorted(files.items())
        if path.is_file() and not name.startswith(".make") and path.suffix != ".py"
    }


def small(folder):
    return folder / "notebooks" / "small.py"


def test_a_run_leaves_the_same_bytes_each_time_whatever_a_users_settings(
    project, tmp_path, monkeypatch
):
    folder = project(small=GOOD)
    execution.run(small(folder))
    first = made_in(folder)
    assert list(first) == LEFT
    assert (folder / ".make" / "small.ran").exists()
    outputs = nbformat.read(folder / LEFT[0], as_version=4).cells[1].outputs
    streams = [each.text for each in outputs if each.output_type == "stream"]
    assert streams == ["['sans-serif']\n"]
    home = tmp_path.parent / "home"
    for name, text in {
        ".config/matplotlib/matplotlibrc": "font.family: serif\n",
        ".ipython/profile_default/startup/0.py": "print('of the profile')\n",
        "startup.py": "print('at the start')\n",
    }.items():
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).write_text(text, "utf-8")
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("PYTHONSTARTUP", str(home / "startup.py"))
    monkeypatch.setenv("MATPLOTLIBRC", str(home / ".config/matplotlib"))
    execution.run(small(folder))
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


@pytest.mark.parametrize(
    ("ending", "says"),
    [
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("time.sleep(60)", ".*timed out"),
        ("os._exit(1)", "Kernel died"),
    ],
)
def test_a_notebook_that_fails_is_named_in_one_line_and_leaves_the_last_results(
    project, ending, says, monkeypatch
):
    folder = project(small=f"{FAILS}{ending}\n")
    (folder / "results").mkdir()
    (folder / "results" / "small.csv").write_text("repeats\n99\n", "utf-8")
    before = made_in(folder)
    monkeypatch.setattr(execution, "CELL_TIMEOUT_S", 2)
    says = rf"^small\.py, code cell 2: {says}.*$"
    with pytest.raises(execution.NotebookFailed, match=says):
        execution.run(small(folder))
    assert made_in(folder) == before
    assert not (folder / ".make" / "small.ran").exists()


def test_an_executed_notebook_that_was_edited_is_never_overwritten(project):
    folder = project(small="# %%\nrepeats = 30\n")
    execution.run(small(folder))
    small(folder).write_text("# %%\nrepeats = 31\n", "utf-8")
    execution.refuse_edited(small(folder))  # a change of the source alone
    notebook = nbformat.read(folder / LEFT[0], as_version=4)
    notebook.cells[0].source = "repeats = 32"
    nbformat.write(notebook, folder / LEFT[0])
    edited = made_in(folder)
    with pytest.raises(UserError, match=r"small\.ipynb: edited, and left as it is"):
        execution.run(small(folder))
    assert made_in(folder) == edited
    small(folder).write_text("# %%\nrepeats = 32\n", "utf-8")  # taken over
    execution.refuse_edited(small(folder))


NEEDS = """# %%
import os
class DataUnavailable(Exception): pass
if os.environ["BACKLASH_RECORDS"] not in {}: raise DataUnavailable("Speeddata3.xlsx: where?")
"""


def test_without_the_authors_files_a_notebook_runs_on_our_records_apart_or_not_at_all(project):
    folder = project(small=NEEDS.format(["simulated"]))
    assert "on our simulated records" in execution.run(small(folder))
    assert list(made_in(folder)) == ["results/offline/notebooks/small.ipynb"]
    assert b"our simulated records" in made_in(folder)["results/offline/notebooks/small.ipynb"]
    folder = project(small=NEEDS.format([]))
    assert "small: not run: Speeddata3.xlsx" in execution.run(small(folder))
    assert not (folder / ".make" / "small.ran").exists()


@pytest.mark.parametrize("name", ["small.ipynb", "missing.py"])
def test_what_is_no_source_of_a_notebook_is_refused(project, name):
    folder = project(small=GOOD)
    with pytest.raises(UserError, match=r"give the \.py source of a notebook"):
        execution.run(folder / "notebooks" / name)


def test_two_notebooks_share_the_cores_and_the_memory():
    assert [execution.count_workers(cores, 2**40) for cores in (1, 2, 4, 16)] == [1, 1, 2, 8]
    assert execution.count_workers(16, 2**32) == 4


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


@pytest.mark.slow
def test_a_killed_make_leaves_no_process_and_no_half_file_and_the_next_one_goes_on(
    project, tmp_path
):
    pids = tmp_path / "pids.txt"
    folder = project(small=GOOD, long=LONG.format(pids=str(pids)))
    make = start_make(folder)
    wait_until(lambda: pids.exists() and len(pids.read_text().split()) == 3, 100)
    wait_until((folder / ".make" / "small.ran").exists, 100)
    started = [process.pid for process in psutil.Process(make.pid).children(recursive=True)]
    make.kill()  # and nobody waits for it
    everything = {*started, *map(int, pids.read_text().split())}
    wait_until(lambda: not everything.intersection(psutil.pids()), 10)
    make.wait()
    assert [name for name in LEFT if name in made_in(folder)] == LEFT
    assert not (folder / "notebooks" / "long.ipynb").exists()
    for source, status in (("1 / 0", 2), ("print(1)", 0)):
        (folder / "notebooks" / "long.py").write_text(f"# %%\n{source}\n", "utf-8")
        assert start_make(folder).wait(100) == status
    assert (folder / "notebooks" / "long.ipynb").exists()


def start_make(folder):
    """Start `make all` of our Makefile on another project's notebooks."""
    shutil.copy(ROOT / "Makefile", folder)
    names = [path.stem for path in (folder / "notebooks").glob("*.py")]
    (folder / ".make").mkdir(exist_ok=True)
    for package in ("workbook", "replication"):
        if not (folder / package).exists():
            (folder / package).symlink_to(ROOT / package)
    (folder / ".venv").mkdir(exist_ok=True)
    for made in ("pyproject.toml", "requirements.lock", ".venv/.installed", ".make/report.made"):
        (folder / made).touch()
    os.utime(folder / ".make" / "report.made", (2**32, 2**32))  # the report is our own project's
    command = ["make", "all", "PACKAGES=", "BEYOND=", f"PY={sys.executable}"]
    command += [f"STAMPS={' '.join(f'.make/{name}.ran' for name in names)}"]
    environment = {name: value for name, value in os.environ.items() if name != "BACKLASH_DATA"}
    return subprocess.Popen(command, cwd=folder, env=environment, stderr=subprocess.DEVNULL)
