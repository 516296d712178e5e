"""Notebooks in kernels: what they leave, what is said when one fails, and that nothing stays whatever ends a run."""

import errno
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import time

import nbformat
import pandas as pd
import psutil
import pytest
from matplotlib import get_cachedir

import workbook
from workbook import checkout, execution, running
from workbook.checkout import notebook_files

GOOD = """# %% tags=["parameters"]
repeats = 30

# %%
import pandas as pd
import workbook
table = pd.DataFrame({"repeats": [repeats]})
cells = {"text.runs": repeats}
workbook.export(tables={"small": table}, supplement={"b": (table, "Of x.")}, pages={"c": {"x": [1]}}, cells=cells)
print("done")
"""
BAD = "\n# %%\n1 / 0\n"
LEFT = [
    "notebooks/small.ipynb",
    "results/outcomes/small.json",
    "results/pages/c.json",
    "results/small.csv",
]
FIRST = workbook.ROOT / "notebooks" / "05_signature_figure6.py"


@pytest.fixture
def notebook(tmp_path):
    """Write a notebook's source, return its path."""

    def write(text, name="small"):
        source = tmp_path / "notebooks" / f"{name}.py"
        source.parent.mkdir(exist_ok=True)
        source.write_text(text, "utf-8")
        return source

    return write


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def bytes_below(folder):
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def cells_of(path):
    return nbformat.read(path, as_version=4).cells


def test_an_executed_notebook_leaves_itself_what_it_exports_and_what_it_was_made_from(
    notebook, out
):
    read = "from replication import published\npublished.value('text.runs')\n"
    source = notebook(f"{GOOD}\n# %%\n{read}random_seed, seeds, reseed = 7, range(1, 4), 1.5\n")
    execution.execute(source, destination=out)
    assert sorted(bytes_below(out)) == sorted([*LEFT, "results/supplement/b.csv"])
    assert cells_of(out / LEFT[0])[1].outputs[-1].text == "done\n"
    outcome = json.loads((out / LEFT[1]).read_text("utf-8"))
    assert outcome["files"] == ["small.csv", "supplement/b.csv", "pages/c.json"]
    sources = outcome["made_from"]["sources"]
    needed = {
        "small.py",
        "requirements.lock",
        "replication/published.py",
        "replication/data/cells.csv",
    }
    assert needed <= set(sources)
    assert "replication/cmaes.py" not in sources
    assert outcome["made_from"]["seeds"] == {"random_seed": 7, "seeds": "range(1, 4)"}
    for name, digest in sources.items():
        path = source if name == "small.py" else workbook.ROOT / name
        assert hashlib.sha256(path.read_bytes()).hexdigest() == digest


def test_a_source_that_is_changed_after_it_was_loaded_is_noted_as_it_was(tmp_path):
    recorder = workbook.ROOT / "workbook" / "recorder.py"
    for name in ("requirements.lock", "notebook.py"):
        (tmp_path / name).touch()
    module = tmp_path / "module.py"
    module.write_text("x = 1\n", "utf-8")
    root = str(tmp_path)
    start = (os.getpid(), root, root, f"{root}/notebook.py")
    code = f"""import runpy, sys; sys.path.insert(0, {root!r})
runpy.run_path({str(recorder)!r})["start"](*{start})
import module; open(module.__file__, "a").write("x = 2")
sys.modules["notebook_recorder"].write({f"{root}/outcome.json"!r}, {{}})"""
    subprocess.run([sys.executable, "-c", code], check=True)
    noted = json.loads((tmp_path / "outcome.json").read_text("utf-8"))["made_from"]["sources"]
    assert noted["module.py"] == hashlib.sha256(b"x = 1\n").hexdigest()


@pytest.mark.slow
def test_two_runs_of_a_notebook_give_the_same_bytes_and_the_committed_texts(authors_data, tmp_path):
    for name in ("one", "two"):
        execution.execute(FIRST, destination=tmp_path / name)
    assert bytes_below(tmp_path / "one") == bytes_below(tmp_path / "two")
    here, committed = (
        [
            (cell.source, [o["data"]["text/plain"] for o in cell.get("outputs", []) if "data" in o])
            for cell in cells_of(folder / FIRST.with_suffix(".ipynb").name)
        ]
        for folder in (tmp_path / "one" / "notebooks", FIRST.parent)
    )
    assert here == committed


def full(*_):
    raise OSError(errno.ENOSPC, "No space left on device")


STALLED = r"small\.py, cell 1: no progress for .* minutes \(STALL_MINUTES"
KILLED = (
    "import os\nfrom joblib import Parallel, delayed\nParallel(2)([delayed(os._exit)(9)] * 2)\n"
)


@pytest.mark.parametrize(
    ("text", "said", "options"),
    [
        (GOOD.replace("[repeats]", "[99]") + BAD, r"small\.py, cell 3: ZeroDivisionError", {}),
        (GOOD + "workbook.export(tables={'other': table})\n", "export is called again", {}),
        ("# %%\nimport time\ntime.sleep(60)\n", STALLED, {"stall_s": 3}),
        ("# %%\nx = 1\n\n# %%\nimport os\nos._exit(1)\n", "cell 2: the kernel died", {}),
        (f"# %%\n{KILLED}", "cell 1: TerminatedWorkerError", {}),
        (GOOD.replace("[repeats]", "[99]"), "No space left", {}),
    ],
)
def test_what_fails_is_named_and_leaves_the_last_results(
    notebook, out, text, said, options, monkeypatch
):
    (out / "results").mkdir(parents=True)
    (out / "results" / "small.csv").write_text("repeats\n30\n", "utf-8")
    before = bytes_below(out)
    if said == "No space left":
        monkeypatch.setattr(execution.nbformat, "write", full)
    with pytest.raises((execution.NotebookFailed, OSError), match=said):
        execution.execute(notebook(text), destination=out, **options)
    assert bytes_below(out) == before


def test_what_a_failed_run_got_to_is_kept_apart_and_is_no_notebook(notebook, out):
    source = notebook(GOOD + BAD, "01_small")
    with pytest.raises(execution.NotebookFailed, match="cell 3"):
        execution.execute(source, destination=out)
    assert cells_of(source.parent / "partial" / "01_small.ipynb")[1].outputs[-1].text == "done\n"
    assert notebook_files("ipynb", source.parent) == {}


@pytest.mark.slow
def test_a_cell_may_take_as_long_as_it_makes_progress(notebook, out):
    steps = "for _ in tqdm(range(40), mininterval=0):\n    time.sleep(0.5)\n"
    source = notebook("# %%\nimport time\nfrom tqdm import tqdm\n" + steps)
    execution.execute(source, stall_s=15, destination=out)
    assert cells_of(out / "notebooks" / "small.ipynb")[0].outputs == []


def test_missing_data_are_told_from_a_failure(notebook, out):
    text = "# %%\nfrom replication import records\nrecords.authors_file('Speeddata99.xlsx')\n"
    with pytest.raises(execution.NotebookNotRun, match=r"small: not run: Speeddata99\.xlsx"):
        execution.execute(notebook(text), destination=out)
    assert bytes_below(out) == {}


def test_a_quick_run_uses_the_quick_parameters_and_an_unknown_one_is_refused(notebook, out):
    header = "# ---\n# jupyter:\n#   replication:\n#     quick: {repeats: 3}\n# ---\n\n"
    execution.execute(notebook(header + GOOD), quick=True, destination=out)
    assert pd.read_csv(out / "results" / "small.csv")["repeats"].tolist() == [3]
    with pytest.raises(ValueError, match=re.escape("no such parameter: repeat; there are repeats")):
        execution.execute(notebook((header + GOOD).replace("{repeats", "{repeat")), out, quick=True)


# ---------------------------------------------------------------------------------------------------------------
# Many notebooks

DONE = "# %%\nprint('done')\n"
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
    notebooks(first=DONE, second=LONG.format(pids=str(pids)))
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
    sources = notebooks(bad="# %%\n1 / 0\n", good=DONE)
    endings = running.run_notebooks(sources, tmp_path / "out")
    assert [ending.how for ending in endings] == ["failed", "done"]
    assert "bad.py, cell 1: ZeroDivisionError" in capsys.readouterr().err
    assert ran(tmp_path) == ["good"]


@pytest.mark.slow
def test_without_the_authors_files_a_notebook_runs_on_our_records_apart(notebooks, tmp_path):
    text = "# %%\nfrom replication.sources import load_clean\nprint(load_clean(12).source)\n"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BACKLASH_DATA", str(tmp_path))
        endings = running.run_notebooks(notebooks(first=text), tmp_path / "out")
    assert [ending.how for ending in endings] == ["simulated"]
    (made,) = (tmp_path / "out").rglob("*.ipynb")
    assert made.is_relative_to(tmp_path / "out" / "results" / "offline")
    text = made.read_text("utf-8")
    assert "On our simulated records" in text
    assert "simulated joint" in text


def test_a_notebook_whose_data_nothing_replaces_is_not_run_and_keeps_its_results(
    notebooks, tmp_path, capsys
):
    text = "# %%\nfrom replication import records\nrecords.authors_file('Speeddata99.xlsx')\n"
    (ending,) = running.run_notebooks(notebooks(first=text), tmp_path / "out")
    assert ending.how == "not run"
    assert "not run: Speeddata99.xlsx" in capsys.readouterr().err
    assert not list((tmp_path / "out").rglob("*.ipynb"))


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
    monkeypatch.delenv("HARDWARE_LOGS", raising=False)
    monkeypatch.setenv("MPLCONFIGDIR", get_cachedir())  # its list of fonts takes seconds
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    before = changed_files()
    endings = running.run_notebooks([*notebook_files("py").values()], tmp_path / "out", quick=True)
    ended = {ending.name: ending.how for ending in endings}
    assert ended.pop("17_logs_of_real_joints") == "not run"
    assert set(ended.values()) == {"done", "simulated"}
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
def test_what_a_killed_run_left_half_done_is_removed_by_the_next(started, notebooks, tmp_path):
    process, _ = started()
    process.kill()
    process.wait()
    assert list((tmp_path / "out").glob(".staging-*"))
    second = notebooks(second=DONE)
    assert [ending.how for ending in running.run_notebooks(second, tmp_path / "out")] == ["done"]
    assert not list((tmp_path / "out").glob(".staging-*"))
