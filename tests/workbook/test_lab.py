"""The student's way in: JupyterLab with paired notebooks, and copies to work on."""

import shutil

import nbformat
import pytest

import workbook
from workbook import lab as lab_copies
from workbook.checkout import notebook_files

pytest.importorskip("jupyter_server", reason="JupyterLab's server is not installed (extra `lab`)")

from jupytext import TextFileContentsManager
from nbformat.sign import NotebookNotary

NAME = "02_dead_zone_figure9"


@pytest.fixture
def copies(tmp_path, monkeypatch):
    """A project's copies of its notebooks."""
    monkeypatch.setenv("JUPYTER_DATA_DIR", str(tmp_path / "data"))  # of signatures
    folder = tmp_path / "lab"
    lab_copies.copy_notebooks(folder)
    return folder


def test_saving_a_notebook_writes_its_source_too(tmp_path):
    shutil.copy(workbook.ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "notebooks").mkdir()
    for ending in ("py", "ipynb"):
        shutil.copy(workbook.ROOT / "notebooks" / f"{NAME}.{ending}", tmp_path / "notebooks")
    lab = TextFileContentsManager()
    lab.root_dir = str(tmp_path)
    model = lab.get(f"notebooks/{NAME}.ipynb")
    for cell in model["content"]["cells"]:
        cell["source"] = cell["source"].replace("delta_rad = 15e-4", "delta_rad = 3e-4")
    lab.save(model, f"notebooks/{NAME}.ipynb")
    committed, written = (
        (root / "notebooks" / f"{NAME}.py").read_text("utf-8").partition("# ---\n\n")[2]
        for root in (workbook.ROOT, tmp_path)
    )
    assert written == committed.replace("delta_rad = 15e-4", "delta_rad = 3e-4")


def test_copies_have_every_notebook_with_an_empty_answer_before_each_folded_solution(copies):
    for name, file in notebook_files("ipynb", copies).items():
        cells = nbformat.read(file, as_version=4).cells
        solved = [k for k, cell in enumerate(cells) if "solution" in cell.metadata.get("tags", [])]
        assert len(solved) == 3, name
        for k in solved:
            assert cells[k - 1].source == "# your answer"
            assert cells[k].source.startswith("<details><summary>Solution</summary>")
            assert "jupyter" not in cells[k].metadata, "folded twice"
    assert set(notebook_files("ipynb", copies)) == set(notebook_files("ipynb"))


def test_a_copy_that_is_there_stays_as_it_was_left(copies):
    mine = next(iter(notebook_files("ipynb", copies).values()))
    mine.write_text("mine", "utf-8")
    assert mine in lab_copies.copy_notebooks(copies)
    assert mine.read_text("utf-8") == "mine"


def test_a_copy_is_signed_so_that_jupyterlab_shows_its_drawings(copies):
    for file in notebook_files("ipynb", copies).values():
        assert NotebookNotary().check_signature(nbformat.read(file, as_version=4)), file.name
