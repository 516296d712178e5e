"""One notebook in a kernel: what it leaves, what is said when it fails, and that the last results stay."""

import errno
import hashlib
import json
import os
import re
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
table = pd.DataFrame({"repeats": [repeats]})
workbook.export(tables={"small": table}, cells={"authors": {"text.runs": repeats}})
print("done")
"""
FIRST = workbook.ROOT / "notebooks" / "01_signature_figure6.py"


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
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def cells_of(path):
    return nbformat.read(path, as_version=4).cells


def refused(source, out, match, **options):
    with pytest.raises(execution.NotebookFailed, match=match):
        execution.execute(source, destination=out, **options)


def test_an_executed_notebook_leaves_its_tables_its_outcome_and_itself(notebook, out):
    execution.execute(notebook(GOOD), destination=out)
    left = ["notebooks/small.ipynb", "results/outcomes/small.json", "results/small.csv"]
    assert sorted(bytes_below(out)) == left
    assert cells_of(out / left[0])[-1].outputs[-1].text == "done\n"


def test_what_an_outcome_lists_is_what_the_notebook_wrote(notebook, out):
    export = """# %%
import pandas as pd
import workbook
table = pd.DataFrame({"x": [1]})
workbook.export(tables={"a": table}, supplement={"b": (table, "Of x.")}, pages={"c": {"x": [1]}})
"""
    execution.execute(notebook(export), destination=out)
    outcome = json.loads((out / "results" / "outcomes" / "small.json").read_text("utf-8"))
    assert outcome["files"] == ["a.csv", "supplement/b.csv", "pages/c.json"]
    assert outcome["supplement"] == {"b": "Of x."}
    assert all((out / "results" / name).exists() for name in outcome["files"])


def test_a_second_export_is_refused_before_it_writes_anything(notebook, out):
    refused(
        notebook(GOOD + "workbook.export(tables={'other': table})\n"), out, "export is called again"
    )
    assert bytes_below(out) == {}


@pytest.fixture(scope="module")
def first_notebook(authors_data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("first")
    execution.execute(FIRST, destination=folder)
    return folder


@pytest.mark.slow
def test_two_runs_of_a_notebook_give_the_same_bytes(first_notebook, tmp_path):
    execution.execute(FIRST, destination=tmp_path)
    assert bytes_below(tmp_path) == bytes_below(first_notebook)
    assert {name.rpartition(".")[2] for name in bytes_below(tmp_path)} == {
        "csv",
        "json",
        "ipynb",
        "png",
        "svg",
    }


@pytest.mark.slow
def test_the_committed_first_notebook_is_what_its_source_gives(first_notebook):
    def texts(path):
        outputs = [(cell.source, cell.get("outputs", [])) for cell in cells_of(path)]
        return [
            (source, [o["data"]["text/plain"] for o in found if "data" in o])
            for source, found in outputs
        ]

    assert texts(first_notebook / "notebooks" / FIRST.with_suffix(".ipynb").name) == texts(
        FIRST.with_suffix(".ipynb")
    )


def full(*_):
    raise OSError(errno.ENOSPC, "No space left on device")


LIMIT = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))\n"


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (
            GOOD.replace("[repeats]", "[99]") + "\n# %%\n1 / 0\n",
            r"small\.py, cell 3: ZeroDivisionError",
        ),
        pytest.param(
            GOOD.replace("import pandas", LIMIT + "import pandas"),
            "cell 2: OSError",
            marks=pytest.mark.slow,
        ),
        (GOOD.replace("[repeats]", "[99]"), "No space left"),
    ],
)
def test_a_failing_cell_and_a_full_disk_leave_the_last_results(
    notebook, out, broken, said, monkeypatch
):
    execution.execute(notebook(GOOD), destination=out)
    before = bytes_below(out)
    if said == "No space left":
        monkeypatch.setattr(execution.nbformat, "write", full)
    with pytest.raises((execution.NotebookFailed, OSError), match=said):
        execution.execute(notebook(broken), destination=out)
    assert bytes_below(out) == before


def test_what_a_failed_run_got_to_is_kept_apart_and_is_no_notebook(notebook, out, tmp_path):
    source = notebook(GOOD + "\n# %%\n1 / 0\n", "01_small")
    refused(source, out, "cell 3")
    assert cells_of(source.parent / "partial" / "01_small.ipynb")[1].outputs[-1].text == "done\n"
    beyond = source.parent / "beyond" / "12_of_the_sensor.ipynb"
    beyond.parent.mkdir()
    for path in (source.with_suffix(".ipynb"), beyond):
        path.touch()
    assert notebook_files("ipynb", source.parent) == {
        "01_small": source.with_suffix(".ipynb"),
        "12_of_the_sensor": beyond,
    }


STALLED = r"small\.py, cell 1: no progress for .* minutes \(STALL_MINUTES"
KILLED = (
    "import os\nfrom joblib import Parallel, delayed\nParallel(2)([delayed(os._exit)(9)] * 2)\n"
)


@pytest.mark.parametrize(
    ("text", "said", "options"),
    [
        # The first is over before the kernel has started.
        ("# %%\nimport time\ntime.sleep(60)\n", STALLED, {"stall_s": 0.3}),
        ("# %%\nimport time\ntime.sleep(60)\n", STALLED, {"stall_s": 3}),
        (
            "# %%\nx = 1\n\n# %%\nimport os\nos._exit(1)\n",
            r"small\.py, cell 2: the kernel died",
            {},
        ),
        (f"# %%\n{KILLED}", r"small\.py, cell 1: TerminatedWorkerError", {}),
    ],
)
def test_a_cell_without_progress_a_dead_kernel_and_a_killed_worker_are_named(
    notebook, out, text, said, options
):
    refused(notebook(text), out, said, **options)
    assert bytes_below(out) == {}


@pytest.mark.slow
def test_a_kernel_that_does_not_start_is_named_and_leaves_nothing_to_fail_at_exit(notebook, out):
    source = str(notebook("# %%\nx = 1\n"))
    code = f"""
from pathlib import Path
from workbook import execution
execution.pinned_environment = lambda: {{"PYTHONHOME": "/nowhere"}}
try:
    execution.execute(Path({source!r}), destination=Path({str(out)!r}))
except execution.NotebookFailed as error:
    print(error)
"""
    environment = os.environ | {"PYTHONPATH": str(workbook.ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert "small.py, cell 1: the kernel died" in done.stdout
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_cell_may_take_as_long_as_it_makes_progress(notebook, out):
    steps = "for _ in tqdm(range(40), mininterval=0):\n    time.sleep(0.5)\n"
    source = notebook("# %%\nimport time\nfrom tqdm import tqdm\n" + steps)
    execution.execute(source, stall_s=15, destination=out)
    assert cells_of(out / "notebooks" / "small.ipynb")[0].outputs == []


def test_a_text_that_arrives_in_pieces_is_kept_as_one(notebook, out):
    source = notebook("# %%\nimport time\nprint('one', flush=True)\ntime.sleep(1)\nprint('two')\n")
    execution.execute(source, destination=out)
    (output,) = cells_of(out / "notebooks" / "small.ipynb")[0].outputs
    assert output["text"] == "one\ntwo\n"


def test_an_outcome_says_what_it_was_made_from(notebook, out):
    read = "from replication import published\npublished.value('text.runs')\n"
    seeds = "random_seed, seeds, reseed = 7, range(1, 4), 1.5\n"
    source = notebook(GOOD + "\n# %%\n" + read + seeds)
    execution.execute(source, destination=out)
    made_from = json.loads((out / "results" / "outcomes" / "small.json").read_text("utf-8"))[
        "made_from"
    ]
    sources = made_from["sources"]
    needed = {
        "small.py",
        "requirements.lock",
        "replication/published.py",
        "replication/data/cells.csv",
    }
    assert needed <= set(sources)
    assert not set(sources) & {
        "replication/search.py",
        "backlash/interface.py",
        "replication/data/map.csv",
    }
    assert made_from["seeds"] == {"random_seed": 7, "seeds": "range(1, 4)"}
    for name, digest in sources.items():
        path = source if name == "small.py" else workbook.ROOT / name
        assert hashlib.sha256(path.read_bytes()).hexdigest() == digest


def test_missing_data_are_told_from_a_failure(notebook, out):
    source = notebook(
        "# %%\nfrom replication import authors\nauthors.authors_file('Speeddata99.xlsx')\n"
    )
    with pytest.raises(execution.NotebookNotRun, match=r"small: not run: Speeddata99\.xlsx"):
        execution.execute(source, destination=out)
    assert bytes_below(out) == {}


def test_a_quick_run_uses_the_quick_parameters_and_an_unknown_one_is_refused(notebook, out):
    header = "# ---\n# jupyter:\n#   replication:\n#     quick: {repeats: 3}\n# ---\n\n"
    execution.execute(notebook(header + GOOD), quick=True, destination=out)
    assert pd.read_csv(out / "results" / "small.csv")["repeats"].tolist() == [3]
    with pytest.raises(ValueError, match=re.escape("no such parameter: repeat; there are repeats")):
        execution.execute(notebook(GOOD), destination=out, parameters={"repeat": 3})


def test_a_kernel_is_found_whatever_is_registered(notebook, out, tmp_path, monkeypatch):
    kernels = tmp_path / "jupyter" / "kernels" / "python3"
    kernels.mkdir(parents=True)
    spec = {"argv": ["/bin/false"], "display_name": "broken", "language": "python"}
    (kernels / "kernel.json").write_text(json.dumps(spec))
    monkeypatch.setenv("JUPYTER_PATH", str(tmp_path / "jupyter"))
    execution.execute(notebook(GOOD), destination=out)
