"""Many notebooks: one failure stops no other, and nothing is left behind whatever ends the run."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest
from matplotlib import get_cachedir

import workbook
from workbook import checkout, execution, running
from workbook.checkout import notebook_files

GOOD = "# %%\nprint('done')\n"
BAD = "# %%\n1 / 0\n"
# Starts a worker pool as the fits do, says which processes there are, and waits.
LONG = """# %%
import os
import time
from pathlib import Path
from joblib import Parallel, delayed
pids = Parallel(2, batch_size=1)(delayed(lambda: (time.sleep(0.3), os.getpid())[1])() for _ in range(4))
path = Path({pids!r})
path.with_suffix(".part").write_text(" ".join(map(str, {{os.getpid(), *pids}})))
path.with_suffix(".part").rename(path)
time.sleep(300)
"""
DRIVER = """
import sys
from pathlib import Path
from workbook import running
folder = Path({folder!r})
try:
    running.run_notebooks(sorted(folder.glob("*.py")), folder / "out", watched={watched})
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.fixture
def notebooks(tmp_path):
    """Write sources by name; return their paths."""

    def write(**texts):
        for name, text in texts.items():
            (tmp_path / f"{name}.py").write_text(text, "utf-8")
        return [tmp_path / f"{name}.py" for name in texts]

    return write


def alive(pids):
    return [
        pid
        for pid in pids
        if psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    ]


def ran(folder):
    """Notebooks that a run has noted as run."""
    return sorted(path.stem for path in (folder / "out" / ".make").glob("*.ran"))


def wait_until(condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.1)


@pytest.fixture
def started(notebooks, tmp_path):
    """Start a run, of a notebook that ends and one that does not, in a process of its own; wait for its workers."""
    pids = tmp_path / "pids"
    notebooks(first=GOOD, second=LONG.format(pids=str(pids)))
    processes = []

    def start(shell=False):
        watched = "int(sys.argv[1])" if shell else "None"
        script = tmp_path / "driver.txt"
        script.write_text(DRIVER.format(folder=str(tmp_path), watched=watched), encoding="utf-8")
        command = [sys.executable, str(script)]
        if shell:
            command = ["sh", "-c", f"{sys.executable} {script} $$; true"]
        environment = os.environ | {"PYTHONPATH": str(workbook.ROOT)}
        process = subprocess.Popen(
            command, env=environment, stderr=subprocess.PIPE, start_new_session=True
        )
        processes.append(process)
        wait_until(lambda: pids.exists() and ran(tmp_path) == ["first"])
        return process, [int(pid) for pid in pids.read_text().split()]

    yield start
    for process in processes:
        process.kill()


def test_a_failing_notebook_does_not_keep_the_others_from_running(notebooks, tmp_path, capsys):
    sources = notebooks(bad=BAD, good=GOOD, later=GOOD)
    endings = running.run_notebooks(sources, tmp_path / "out")
    assert [ending.how for ending in endings] == ["failed", "done", "done"]
    assert "bad.py, cell 1: ZeroDivisionError" in capsys.readouterr().err
    assert ran(tmp_path) == ["good", "later"]


def test_without_the_authors_files_a_notebook_runs_on_our_records_apart(notebooks, tmp_path):
    text = "# %%\nfrom replication.authors import load_clean\nprint(load_clean(12).source)\n"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BACKLASH_DATA", str(tmp_path))
        endings = running.run_notebooks(notebooks(first=text), tmp_path / "out")
    assert [ending.how for ending in endings] == ["simulated"]
    (made,) = (tmp_path / "out").rglob("*.ipynb")
    assert made.is_relative_to(tmp_path / "out" / "results" / "offline")
    text = made.read_text("utf-8")
    assert "On our simulated records" in text
    assert "simulated joint" in text


def changed_files():
    """What differs from the last commit, in full."""
    return subprocess.run(
        ["git", "diff"], cwd=workbook.ROOT, capture_output=True, check=True
    ).stdout


@pytest.mark.slow
def test_without_data_and_network_every_notebook_runs_and_nothing_committed_changes(
    tmp_path, monkeypatch
):
    monkeypatch.delenv("BACKLASH_DATA")
    monkeypatch.setenv("MPLCONFIGDIR", get_cachedir())  # its list of fonts takes seconds
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    before = changed_files()
    endings = running.run_notebooks([*notebook_files("py").values()], tmp_path / "out", quick=True)
    assert {ending.how for ending in endings} == {"done", "simulated"}
    assert changed_files() == before


def test_a_second_run_in_one_checkout_says_who_runs(tmp_path):
    with (
        checkout.lock(tmp_path),
        pytest.raises(checkout.CheckoutBusy, match=f"process {os.getpid()} makes"),
        checkout.lock(tmp_path),
    ):
        pass


def test_workers_are_no_more_than_memory_and_cores_allow():
    assert [execution.count_workers(2**k, cores=8) for k in (28, 31, 40)] == [1, 4, 8]


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_when_the_run_ends_so_does_all_that_it_started(started, tmp_path, number):
    process, pids = started()
    assert len(alive(pids)) == 3
    process.send_signal(number)
    assert process.wait(60) == (-number if number == signal.SIGKILL else 130)
    wait_until(lambda: not alive(pids))
    assert ran(tmp_path) == ["first"]
    assert not (tmp_path / "out" / "notebooks" / "second.ipynb").exists()


@pytest.mark.slow
def test_when_make_is_killed_the_run_ends_and_all_that_it_started(started):
    process, pids = started(shell=True)
    run = psutil.Process(process.pid).children()[0]
    process.kill()
    wait_until(lambda: not alive([*pids, run.pid]))


@pytest.mark.slow
def test_a_killed_kernel_takes_its_workers_along_and_is_named(started, notebooks, tmp_path):
    process, pids = started()
    workers = [pid for pid in pids if psutil.Process(pid).ppid() in pids]
    (kernel,) = set(pids) - set(workers)
    os.kill(kernel, signal.SIGKILL)
    assert process.wait(60) == 0
    assert b"second.py, cell 1: the kernel died" in process.stderr.read()
    wait_until(lambda: not alive(pids))


@pytest.mark.slow
def test_what_a_killed_run_left_half_done_is_removed_by_the_next(started, notebooks, tmp_path):
    process, _ = started()
    process.kill()
    process.wait()
    assert list((tmp_path / "out").glob(".staging-*"))
    second = notebooks(second=GOOD)
    assert [ending.how for ending in running.run_notebooks(second, tmp_path / "out")] == ["done"]
    assert not list((tmp_path / "out").glob(".staging-*"))


def test_count_and_time_left_are_read_off_a_progress_bar():
    assert (
        execution.count_and_time_left("fits:  45%|####  | 45/100 [00:10<00:12, 4.4it/s]")
        == "45/100, 00:12 left"
    )
    assert execution.count_and_time_left("no bar") == ""
