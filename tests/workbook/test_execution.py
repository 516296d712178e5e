import errno
import hashlib
import json
import os
import subprocess
import sys

import nbformat
import pandas as pd
import pytest

import workbook
from workbook import execution
from workbook.checkout import notebook_files

GOOD = """# %% tags=["parameters"]
repeats = 30

# %%
import pandas as pd
import workbook
workbook.export({"small": pd.DataFrame({"repeats": [repeats]})}, cells={"authors": {"text.runs": repeats}})
print("done")
"""


@pytest.fixture
def notebook(tmp_path):
    """Write a notebook's source, return its path."""

    def write(text, name="small"):
        source = tmp_path / "notebooks" / f"{name}.py"
        source.parent.mkdir(exist_ok=True)
        source.write_text(text, encoding="utf-8")
        return source

    return write


def files_below(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_an_executed_notebook_leaves_its_tables_its_outcome_and_itself(notebook, tmp_path):
    execution.execute(notebook(GOOD), destination=tmp_path / "out")
    assert files_below(tmp_path / "out") == [
        "notebooks/small.ipynb",
        "results/outcomes/small.json",
        "results/small.csv",
    ]
    executed = nbformat.read(tmp_path / "out" / "notebooks" / "small.ipynb", as_version=4)
    assert executed.cells[-1].outputs[-1].text == "done\n"


FIRST = workbook.ROOT / "notebooks" / "01_signature_figure6.py"


@pytest.fixture(scope="module")
def first_notebook(authors_data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("first")
    execution.execute(FIRST, destination=folder)
    return folder


@pytest.mark.slow
def test_two_runs_of_a_notebook_give_the_same_bytes(first_notebook, tmp_path):
    execution.execute(FIRST, destination=tmp_path)
    names = files_below(tmp_path)
    assert names == files_below(first_notebook)
    assert {name.rpartition(".")[2] for name in names} == {"csv", "json", "ipynb", "png", "svg"}
    for name in names:
        assert (tmp_path / name).read_bytes() == (first_notebook / name).read_bytes(), name


@pytest.mark.slow
def test_the_committed_first_notebook_is_what_its_source_gives(first_notebook):
    fresh = nbformat.read(first_notebook / "notebooks" / "01_signature_figure6.ipynb", as_version=4)
    committed = nbformat.read(FIRST.with_suffix(".ipynb"), as_version=4)
    for new, old in zip(fresh.cells, committed.cells, strict=True):
        assert new.source == old.source
        new_text = [out["data"]["text/plain"] for out in new.get("outputs", []) if "data" in out]
        old_text = [out["data"]["text/plain"] for out in old.get("outputs", []) if "data" in out]
        assert new_text == old_text


def test_a_failing_cell_is_named_and_the_last_results_stay(notebook, tmp_path):
    out = tmp_path / "out"
    execution.execute(notebook(GOOD), destination=out)
    before = {name: (out / name).read_bytes() for name in files_below(out)}
    broken = notebook(GOOD.replace("[repeats]", "[99]") + "\n# %%\n1 / 0\n")
    with pytest.raises(execution.NotebookFailed, match=r"small\.py, cell 3: ZeroDivisionError"):
        execution.execute(broken, destination=out)
    assert {name: (out / name).read_bytes() for name in files_below(out)} == before
    partial = nbformat.read(broken.parent / "partial" / "small.ipynb", as_version=4)
    assert partial.cells[1].outputs[-1].text == "done\n"


def test_what_a_failed_run_got_to_is_no_notebook(tmp_path):
    for name in ("01_of_the_paper.ipynb", "beyond/12_of_the_sensor.ipynb", "partial/01_of_the_paper.ipynb"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    found = {"01_of_the_paper": "01_of_the_paper.ipynb", "12_of_the_sensor": "beyond/12_of_the_sensor.ipynb"}
    assert notebook_files("ipynb", tmp_path) == {name: tmp_path / path for name, path in found.items()}


@pytest.mark.parametrize("stall_s", [0.3, 3])  # the first is over before the kernel has started
def test_a_cell_without_progress_is_named(notebook, tmp_path, stall_s):
    source = notebook("# %%\nimport time\ntime.sleep(60)\n")
    with pytest.raises(
        execution.NotebookFailed, match=r"small\.py, cell 1: no progress for .* minutes \(STALL_MINUTES"
    ):
        execution.execute(source, stall_s=stall_s, destination=tmp_path / "out")
    assert files_below(tmp_path / "out") == []


@pytest.mark.slow
def test_a_cell_may_take_as_long_as_it_makes_progress(notebook, tmp_path):
    steps = "for _ in tqdm(range(40), mininterval=0):\n    time.sleep(0.5)\n"
    source = notebook("# %%\nimport time\nfrom tqdm import tqdm\n" + steps)
    execution.execute(source, stall_s=15, destination=tmp_path / "out")
    executed = nbformat.read(tmp_path / "out" / "notebooks" / "small.ipynb", as_version=4)
    assert executed.cells[0].outputs == []


def test_a_text_that_arrives_in_pieces_is_kept_as_one(notebook, tmp_path):
    source = notebook("# %%\nimport time\nprint('one', flush=True)\ntime.sleep(1)\nprint('two')\n")
    execution.execute(source, destination=tmp_path / "out")
    executed = nbformat.read(tmp_path / "out" / "notebooks" / "small.ipynb", as_version=4)
    assert [output["text"] for output in executed.cells[0].outputs] == ["one\ntwo\n"]


def test_a_dead_kernel_is_named(notebook, tmp_path):
    source = notebook("# %%\nx = 1\n\n# %%\nimport os\nos._exit(1)\n")
    with pytest.raises(execution.NotebookFailed, match=r"small\.py, cell 2: the kernel died"):
        execution.execute(source, destination=tmp_path / "out")
    assert files_below(tmp_path / "out") == []


@pytest.mark.slow
def test_a_kernel_that_does_not_start_is_named_and_leaves_nothing_to_fail_at_exit(notebook, tmp_path):
    source, out = notebook("# %%\nx = 1\n"), tmp_path / "out"
    code = f"""
from pathlib import Path
from workbook import execution
execution.pinned_environment = lambda: {{"PYTHONHOME": "/nowhere"}}
try:
    execution.execute(Path({str(source)!r}), destination=Path({str(out)!r}))
except execution.NotebookFailed as error:
    print(error)
"""
    environment = os.environ | {"PYTHONPATH": str(workbook.ROOT)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert "small.py, cell 1: the kernel died" in done.stdout
    assert "Traceback" not in done.stderr


def test_a_killed_worker_of_a_parallel_loop_is_named(notebook, tmp_path):
    source = notebook(
        "# %%\nimport os\nfrom joblib import Parallel, delayed\nParallel(2)([delayed(os._exit)(9)] * 2)\n"
    )
    with pytest.raises(execution.NotebookFailed, match=r"small\.py, cell 1: TerminatedWorkerError"):
        execution.execute(source, destination=tmp_path / "out")


@pytest.mark.slow
def test_a_full_disk_in_a_cell_leaves_the_last_results(notebook, tmp_path):
    out = tmp_path / "out"
    execution.execute(notebook(GOOD), destination=out)
    before = {name: (out / name).read_bytes() for name in files_below(out)}
    limit = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))\n"
    with pytest.raises(execution.NotebookFailed, match=r"cell 2: OSError"):
        execution.execute(notebook(GOOD.replace("import pandas", limit + "import pandas")), destination=out)
    assert {name: (out / name).read_bytes() for name in files_below(out)} == before


def test_a_full_disk_after_the_last_cell_leaves_the_last_results(notebook, tmp_path, monkeypatch):
    out = tmp_path / "out"
    execution.execute(notebook(GOOD), destination=out)
    before = {name: (out / name).read_bytes() for name in files_below(out)}

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(execution.nbformat, "write", full)
    with pytest.raises(OSError, match="No space left"):
        execution.execute(notebook(GOOD.replace("[repeats]", "[99]")), destination=out)
    assert {name: (out / name).read_bytes() for name in files_below(out)} == before


def test_an_outcome_says_what_it_was_made_from(notebook, tmp_path):
    read = "from replication import published\npublished.value('text.runs')\n"
    seeds = "random_seed, seeds, reseed = 7, range(1, 4), 1.5\n"
    execution.execute(notebook(GOOD + "\n# %%\n" + read + seeds), destination=tmp_path / "out")
    outcome = json.loads((tmp_path / "out" / "results" / "outcomes" / "small.json").read_text(encoding="utf-8"))
    made_from = outcome["made_from"]
    assert {"small.py", "requirements.lock", "replication/published.py", "replication/data/cells.csv"} <= set(
        made_from["sources"]
    )
    unread = {"replication/search.py", "backlash/fitting/global_fit.py", "replication/data/map.csv"}
    assert not unread & set(made_from["sources"])
    assert made_from["seeds"] == {"random_seed": 7, "seeds": "range(1, 4)"}
    for name, digest in made_from["sources"].items():
        path = workbook.ROOT / name if "/" in name or name == "requirements.lock" else tmp_path / "notebooks" / name
        assert hashlib.sha256(path.read_bytes()).hexdigest() == digest


def test_missing_data_are_told_from_a_failure(notebook, tmp_path):
    source = notebook("# %%\nfrom replication import authors\nauthors.authors_file('Speeddata99.xlsx')\n")
    with pytest.raises(execution.NotebookNotRun, match=r"small: not run: Speeddata99\.xlsx"):
        execution.execute(source, destination=tmp_path / "out")
    assert files_below(tmp_path / "out") == []


def test_a_quick_run_uses_the_quick_parameters(notebook, tmp_path):
    header = "# ---\n# jupyter:\n#   replication:\n#     quick: {repeats: 3}\n# ---\n\n"
    execution.execute(notebook(header + GOOD), quick=True, destination=tmp_path / "out")
    assert pd.read_csv(tmp_path / "out" / "results" / "small.csv")["repeats"].tolist() == [3]


def test_an_unknown_parameter_is_refused(notebook):
    with pytest.raises(ValueError, match="no such parameter: repeat;"):
        execution.with_parameters(execution.read_notebook(notebook(GOOD)), {"repeat": 3})


def test_a_kernel_is_found_whatever_is_registered(notebook, tmp_path, monkeypatch):
    kernels = tmp_path / "jupyter" / "kernels" / "python3"
    kernels.mkdir(parents=True)
    (kernels / "kernel.json").write_text('{"argv": ["/bin/false"], "display_name": "broken", "language": "python"}')
    monkeypatch.setenv("JUPYTER_PATH", str(tmp_path / "jupyter"))
    execution.execute(notebook(GOOD), destination=tmp_path / "out")
