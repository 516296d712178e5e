"""The student's way in: JupyterLab with paired notebooks, and the environment that starts in a browser."""

import os
import re
import shutil
import subprocess
import sys

import nbformat
import pytest

import workbook
from workbook import lab as lab_copies
from workbook.checkout import notebook_files

pytest.importorskip("jupyter_server", reason="JupyterLab's server is not installed (extra `lab`)")

from jupyter_core.paths import jupyter_config_path
from jupyter_server.services.config.manager import ConfigManager
from jupytext import TextFileContentsManager

NAME = "02_dead_zone_figure9"


@pytest.fixture
def lab(tmp_path):
    """JupyterLab's file manager on a copy of a paired notebook."""
    shutil.copy(workbook.ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "notebooks").mkdir()
    for ending in ("py", "ipynb"):
        shutil.copy(workbook.ROOT / "notebooks" / f"{NAME}.{ending}", tmp_path / "notebooks")
    manager = TextFileContentsManager()
    manager.root_dir = str(tmp_path)
    return manager


def test_the_server_loads_the_pairing_by_itself():
    found = ConfigManager(read_config_path=jupyter_config_path()).get("jupyter_server_config")
    assert found["ServerApp"]["jpserver_extensions"]["jupyterlab_jupytext"]


def test_saving_a_notebook_writes_its_source_too(lab, tmp_path):
    model = lab.get(f"notebooks/{NAME}.ipynb")
    cell = next(
        cell
        for cell in model["content"]["cells"]
        if "parameters" in cell["metadata"].get("tags", [])
    )
    cell["source"] = cell["source"].replace("15e-4", "3e-4")
    lab.save(model, f"notebooks/{NAME}.ipynb")
    committed = (workbook.ROOT / "notebooks" / f"{NAME}.py").read_text("utf-8")
    written = (tmp_path / "notebooks" / f"{NAME}.py").read_text("utf-8")
    assert "delta_rad = 3e-4" in written
    body = committed.partition("# ---\n\n")[2].replace("delta_rad = 15e-4", "delta_rad = 3e-4")
    assert written.partition("# ---\n\n")[2] == body


def test_an_edited_source_shows_in_the_notebook_which_keeps_its_outputs(lab, tmp_path):
    source = tmp_path / "notebooks" / f"{NAME}.py"
    source.write_text(
        source.read_text("utf-8").replace("half of the play", "half the play"), encoding="utf-8"
    )
    later = (tmp_path / "notebooks" / f"{NAME}.ipynb").stat().st_mtime + 10
    os.utime(source, (later, later))
    content = lab.get(f"notebooks/{NAME}.ipynb")["content"]
    assert any("half the play" in cell["source"] for cell in content["cells"])
    assert any(cell.get("outputs") for cell in content["cells"])


@pytest.fixture
def copies(tmp_path):
    """A project's copies of its notebooks."""
    folder = tmp_path / "lab"
    lab_copies.copy_notebooks(folder)
    return folder


def test_copies_have_every_notebook_with_an_empty_answer_before_each_folded_solution(copies):
    for name, file in notebook_files("ipynb", copies).items():
        cells = nbformat.read(file, as_version=4).cells
        solved = [k for k, cell in enumerate(cells) if "solution" in cell.metadata.get("tags", [])]
        assert len(solved) == 3, name
        for k in solved:
            assert cells[k - 1].source == "# your answer"
            assert cells[k].cell_type == "markdown"
            assert cells[k].source.startswith("<details><summary>Solution</summary>")
    assert set(notebook_files("ipynb", copies)) == set(notebook_files("ipynb"))
    assert (copies / "glossary.md").exists()


def test_a_copy_that_is_there_stays_as_it_was_left(copies):
    mine = next(iter(notebook_files("ipynb", copies).values()))
    mine.write_text("mine", "utf-8")
    kept = lab_copies.copy_notebooks(copies)
    assert mine in kept
    assert mine.read_text("utf-8") == "mine"


def test_a_copy_is_paired_with_no_source_and_its_link_leads_to_the_report(copies, tmp_path):
    shutil.copy(workbook.ROOT / "pyproject.toml", tmp_path)
    manager = TextFileContentsManager()
    manager.root_dir = str(copies)
    model = manager.get(f"{NAME}.ipynb")
    manager.save(model, f"{NAME}.ipynb")
    assert not list(copies.rglob("*.py"))
    copy = copies / "beyond" / "15_protocols.ipynb"
    assert "](../results/pages/replay_explorer.html)" in copy.read_text("utf-8")
    assert manager.get("results/report.html", content=False)["type"] == "file"


@pytest.mark.parametrize("edited", [None, "alphas = [1e8]", "# my answer"])
def test_an_experiment_is_forgotten_once_its_copy_is_as_it_was_but_for_answers(
    edited, copies, tmp_path
):
    note, copy = tmp_path / "outcomes" / f"{NAME}.json", copies / f"{NAME}.ipynb"
    note.parent.mkdir()
    note.write_text("{}")
    notebook = nbformat.read(copy, as_version=4)
    if edited:
        tag = {"a": "parameters", "#": ""}[edited[0]]
        cell = next(
            cell
            for cell in notebook.cells
            if (tag in cell.metadata.get("tags", []) if tag else cell.id.endswith("-answer"))
        )
        cell.source += f"\n{edited}"
    nbformat.write(notebook, copy)
    os.utime(note, (1, 1))
    lab_copies.forget_undone(copies, tmp_path)
    assert note.exists() == (edited == "alphas = [1e8]")
    note.write_text("{}")  # a run that is not saved yet
    later = copy.stat().st_mtime + 10
    os.utime(note, (later, later))
    lab_copies.forget_undone(copies, tmp_path)
    assert note.exists()
    copy.unlink()
    lab_copies.forget_undone(copies, tmp_path)
    assert not note.exists()


def test_git_ignores_the_copies():
    ignored = subprocess.run(
        ["git", "check-ignore", "lab/x.ipynb"], cwd=workbook.ROOT, capture_output=True, check=False
    )
    assert ignored.stdout.strip() == b"lab/x.ipynb"


def test_the_browser_environment_is_the_locked_one():
    folder = workbook.ROOT / ".binder"
    python = re.fullmatch(r"python-(\d+)\.(\d+)\n", (folder / "runtime.txt").read_text("utf-8"))
    assert (int(python[1]), int(python[2])) >= (3, 11)
    for script in ("postBuild", "start"):
        assert os.access(folder / script, os.X_OK)
    assert "--requirement requirements.lock" in (folder / "postBuild").read_text("utf-8")
    assert (workbook.ROOT / "requirements.lock").exists()


def test_the_start_script_makes_the_package_importable():
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [
        workbook.ROOT / ".binder" / "start",
        sys.executable,
        "-c",
        "import os; os.chdir('/'); import replication",
    ]
    subprocess.run(command, cwd=workbook.ROOT, env=environment, check=True)
