"""The student's copies of the notebooks in `lab/`: what is saved there touches no committed notebook."""

import shutil
from pathlib import Path

import nbformat

from replication.files import ROOT, write_text
from workbook.checkout import NOTEBOOKS, RESULTS, notebook_files

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
            notebook.metadata["jupytext"] = {"formats": "ipynb"}  # no source is paired with it
            text = nbformat.writes(notebook).replace("../results/", "results/")
            write_text(copy, text + "\n")
    for page in NOTEBOOKS.glob("*.md"):
        shutil.copy(page, folder)
    if not (folder / "results").exists():
        (folder / "results").symlink_to(RESULTS)  # JupyterLab opens nothing above its folder
    write_text(folder / WIDGETS, '{"saveState": true}\n')
    return kept


def forget_undone(folder: Path = LAB, results: Path = RESULTS / "lab" / "results") -> None:
    """Remove outcomes of experiments that are undone: the copy is gone, or was saved later with the code as it was."""
    for name, file in notebook_files("ipynb").items():
        note = results / "outcomes" / f"{name}.json"
        copy = folder / file.relative_to(NOTEBOOKS)
        if note.exists() and not (
            copy.exists()
            and (copy.stat().st_mtime < note.stat().st_mtime or _code(copy) != _code(file))
        ):
            note.unlink()


def _code(file: Path) -> list[str]:
    """A notebook's code, but for answers and solutions."""
    return [
        cell.source
        for cell in nbformat.read(file, as_version=4).cells
        if cell.cell_type == "code"
        and not cell.id.endswith("-answer")
        and "solution" not in cell.metadata.get("tags", [])
    ]


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
