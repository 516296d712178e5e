"""The student's copies of the notebooks in `lab/`: what is saved there touches no committed notebook."""

import shutil
from pathlib import Path

import nbformat

from replication.files import ROOT, write_text
from workbook.checkout import NOTEBOOKS, notebook_files

LAB = ROOT / "lab"
# Sliders stay in a saved notebook.
WIDGETS = Path(".settings", "@jupyter-widgets", "jupyterlab-manager", "plugin.jupyterlab-settings")


def copy_notebooks(folder: Path = LAB) -> list[Path]:
    """Copy the executed notebooks; return the copies that were there before, which stay as they are."""
    kept = []
    for file in notebook_files("ipynb").values():
        copy = folder / file.relative_to(NOTEBOOKS)
        if copy.exists():
            kept.append(copy)
        else:
            notebook = with_empty_answers(nbformat.read(file, as_version=4))
            write_text(copy, nbformat.writes(notebook) + "\n")
    shutil.copy(NOTEBOOKS / "glossary.md", folder)
    write_text(folder / WIDGETS, '{"saveState": true}\n')
    return kept


def with_empty_answers(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """Put an empty cell before each solution, and fold the solution into a text that no run executes."""
    cells = []
    for cell in notebook.cells:
        if "solution" in cell.metadata.get("tags", []):
            cells.append(nbformat.v4.new_code_cell("# your answer", id=f"{cell.id}-answer"))
            text = f"<details><summary>Solution</summary>\n\n```python\n{cell.source}\n```\n\n</details>"
            cell = nbformat.v4.new_markdown_cell(text, id=cell.id, metadata=cell.metadata)
        cells.append(cell)
    notebook.cells = cells
    return notebook
