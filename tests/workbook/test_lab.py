"""The student's copies: signed, without answers, and never touched again."""

import nbformat
import pytest
from nbformat.sign import NotebookNotary
from nbformat.v4 import new_code_cell, new_notebook, new_output

from workbook import lab

SOLUTION = "A = 1.0\nprint(A)"


@pytest.fixture
def copies(tmp_path, monkeypatch):
    """A folder with copies of one notebook, of a question with its check."""
    monkeypatch.setenv("JUPYTER_DATA_DIR", str(tmp_path / "signatures"))
    monkeypatch.setattr(lab, "NOTEBOOKS", tmp_path / "notebooks")
    executed = tmp_path / "notebooks" / "00_first.ipynb"
    monkeypatch.setattr(lab, "notebook_sources", lambda: {"00_first": executed.with_suffix(".py")})
    printed = [new_output("stream", text="right")]
    cells = [
        new_code_cell(SOLUTION, metadata={"tags": ["solution"]}, outputs=printed),
        new_code_cell("print('right')", metadata={"tags": ["check"]}, outputs=printed),
        new_code_cell("print('right')", outputs=printed),
    ]
    executed.parent.mkdir()
    nbformat.write(new_notebook(cells=cells), executed)
    assert lab.copy_notebooks(tmp_path / "lab") == []
    return tmp_path / "lab"


def test_a_solution_becomes_a_question_and_its_check_stays_without_an_answer(copies):
    asked, check, other = nbformat.read(copies / "00_first.ipynb", as_version=4).cells
    assert asked.source == "# Your answer:"
    assert check.source == "print('right')"
    assert [len(cell.outputs) for cell in (asked, check, other)] == [0, 0, 1]


def test_a_copy_is_trusted_and_once_edited_never_touched(copies):
    copy = copies / "00_first.ipynb"
    assert NotebookNotary().check_signature(nbformat.read(copy, as_version=4))
    copy.write_text("edited", "utf-8")
    assert lab.copy_notebooks(copies) == [copy]
    assert copy.read_text("utf-8") == "edited"
