"""A notebook in a kernel: what it leaves, what is said when it fails, and that nothing stays when a run is killed."""

import os
import shutil
import subprocess
import sys
import time

import nbformat
import psutil
import pytest

from replication.records import UserError
from workbook import ROOT, execution

GOOD = """# %% tags=["parameters"]
repeats = 30

# %%
import sys
import pandas as pd
import workbook
table = pd.DataFrame({"repeats": [repeats]})
workbook.verdict("Thirty.", cells={"text.runs": repeats}, tables={"small": table})
print("a bar of progress", file=sys.stderr)
print("done")
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


def test_a_run_leaves_the_executed_notebook_and_what_it_exports_the_same_bytes_each_time(project):
    folder = project(small=GOOD)
    execution.run(small(folder))
    first = made_in(folder)
    assert list(first) == LEFT
    assert (folder / ".make" / "small.ran").exists()
    notebook = nbformat.read(folder / LEFT[0], as_version=4)
    outputs = notebook.cells[1].outputs
    assert [each.get("text") for each in outputs if each.output_type == "stream"] == ["done\n"]
    execution.run(small(folder))
    assert made_in(folder) == first


def test_the_settings_of_a_user_reach_no_notebook(project, tmp_path, monkeypatch):
    home = tmp_path / "home"
    for name, text in {
        ".config/matplotlib/matplotlibrc": "font.family: serif\n",
        ".ipython/profile_default/startup/0.py": "print('of the profile')\n",
        ".ipython/profile_default/ipython_config.py": "c.InteractiveShell.ast_node_interactivity = 'all'\n",
        "startup.py": "print('at the start')\n",
    }.items():
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).write_text(text, "utf-8")
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("PYTHONSTARTUP", str(home / "startup.py"))
    monkeypatch.setenv("MATPLOTLIBRC", str(home / ".config/matplotlib"))
    text = "# %%\nimport matplotlib\n1\nprint(matplotlib.rcParams['font.family'])\n"
    folder = project(small=text)
    execution.run(small(folder))
    (cell,) = nbformat.read(folder / LEFT[0], as_version=4).cells
    assert [output.text for output in cell.outputs] == ["['sans-serif']\n"]


# It leaves a result before it fails.
FAILS = """# %%
import os
from pathlib import Path
results = Path(os.environ["REPLICATION_OUT"], "results")
results.mkdir()
(results / "small.csv").write_text("repeats\\n30\\n")

# %%
"""


@pytest.mark.parametrize(
    ("ending", "says", "timeout_s"),
    [
        ("1 / 0", r"small\.py, code cell 2: ZeroDivisionError: division by zero", 900),
        ("import time\ntime.sleep(60)", r"small\.py, code cell 2: .*timed out", 3),
        ("os._exit(1)", r"small\.py, code cell 2: Kernel died", 900),
    ],
)
def test_a_notebook_that_fails_is_named_in_one_line_and_leaves_the_last_results(
    project, ending, says, timeout_s, monkeypatch
):
    folder = project(small=f"{FAILS}{ending}\n")
    (folder / "results").mkdir()
    (folder / "results" / "small.csv").write_text("repeats\n99\n", "utf-8")
    before = made_in(folder)
    monkeypatch.setattr(execution, "CELL_TIMEOUT_S", timeout_s)
    with pytest.raises(execution.NotebookFailed, match=says) as failed:
        execution.run(small(folder))
    assert "\n" not in str(failed.value)
    assert made_in(folder) == before
    assert not (folder / ".make" / "small.ran").exists()


def test_a_full_disk_is_said_in_one_line(project, monkeypatch):
    def write(*_):
        raise OSError(28, "No space left on device")

    folder = project(small="# %%\n1\n")
    monkeypatch.setattr(nbformat, "write", write)
    with pytest.raises(execution.NotebookFailed, match=r"^small\.py: .* No space left .*\.make$"):
        execution.run(small(folder))
    assert made_in(folder) == {}


def test_a_kernel_that_cannot_start_is_said_in_one_line(project, capfd):
    folder = project(small="# %%\n1\n")
    profile = folder / ".make" / "settings" / "IPYTHONDIR" / "profile_default"
    profile.parent.mkdir(parents=True)
    profile.touch()  # which is a folder's place
    with pytest.raises(execution.NotebookFailed, match=r"Kernel died .*profile_default") as failed:
        execution.run(small(folder))
    assert "\n" not in str(failed.value)
    assert capfd.readouterr().err == ""


def test_an_executed_notebook_that_was_edited_is_never_overwritten(project):
    folder = project(small="# %%\nrepeats = 30\n")
    execution.run(small(folder))
    small(folder).write_text("# %%\nrepeats = 31\n", "utf-8")
    execution.run(small(folder))  # a change of the source alone is none of the executed notebook
    executed = folder / LEFT[0]
    notebook = nbformat.read(executed, as_version=4)
    notebook.cells[0].source = "repeats = 32"
    nbformat.write(notebook, executed)
    edited = made_in(folder)
    for clock in (0, 2**31):  # whatever file seems to be the newer one
        os.utime(executed, (clock, clock))
        with pytest.raises(UserError, match=r"small\.ipynb: edited, and left as it is"):
            execution.run(small(folder))
        assert made_in(folder) == edited
    small(folder).write_text("# %%\nrepeats = 32\n", "utf-8")  # taken over
    execution.refuse_edited(small(folder))


@pytest.fixture
def no_data(tmp_path, monkeypatch):
    """No folder with the authors' files, nor a cache, nor a network to download them from."""
    monkeypatch.delenv("BACKLASH_DATA")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_without_the_authors_files_a_notebook_runs_on_our_records_apart_and_is_due_again(
    project, no_data
):
    text = "# %%\nfrom replication.records import load_clean\nprint(load_clean(12).source)\n"
    folder = project(small=text)
    assert "on our simulated records" in execution.run(small(folder))
    assert list(made_in(folder)) == ["results/offline/notebooks/small.ipynb"]
    assert b"simulated joint" in made_in(folder)["results/offline/notebooks/small.ipynb"]
    assert not (folder / ".make" / "small.ran").exists()


def test_a_notebook_whose_data_nothing_replaces_is_not_run(project, no_data):
    text = "# %%\nclass DataUnavailable(Exception): pass\nraise DataUnavailable('Speeddata3.xlsx: where?')\n"
    folder = project(small=text)
    assert "small: not run: Speeddata3.xlsx" in execution.run(small(folder))
    assert made_in(folder) == {}


@pytest.mark.parametrize("name", ["small.ipynb", "missing.py"])
def test_what_is_no_source_of_a_notebook_is_refused(project, name):
    folder = project(small=GOOD)
    with pytest.raises(UserError, match=r"give the \.py source of a notebook"):
        execution.run(folder / "notebooks" / name)


def test_two_notebooks_share_the_cores_and_the_memory():
    assert [execution.count_workers(cores, 2**40) for cores in (1, 2, 4, 16)] == [1, 2, 2, 8]
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
    (folder / "notebooks" / "long.py").write_text("# %%\nprint(1)\n", "utf-8")
    assert start_make(folder).wait(100) == 0
    assert (folder / "notebooks" / "long.ipynb").exists()


@pytest.mark.slow
def test_one_notebook_that_fails_stops_no_other_and_make_ends_badly(project):
    folder = project(bad="# %%\n1 / 0\n", small=GOOD)
    assert start_make(folder).wait(100) == 2
    assert (folder / ".make" / "small.ran").exists()
    (folder / "notebooks" / "bad.py").write_text("# %%\n1 / 1\n", "utf-8")
    assert start_make(folder).wait(100) == 0


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
