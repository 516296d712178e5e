"""The student's copies of the notebooks in `lab/`: what is saved there touches no committed notebook."""

import shutil
from pathlib import Path

import nbformat
from nbformat.sign import NotebookNotary

from replication.files import ROOT, write_text
from workbook.checkout import NOTEBOOKS, RESULTS, notebook_files

LAB = ROOT / "lab"
# Settings of JupyterLab: sliders stay in a saved notebook; no news and no updates are asked for.
SETTINGS = {
    "@jupyter-widgets/jupyterlab-manager/plugin": '{"saveState": true}',
    "@jupyterlab/apputils-extension/notification": '{"fetchNews": "false", "checkForUpdates": false}',
}


def copy_notebooks(folder: Path = LAB) -> list[Path]:
    """Copy the executed notebooks; return the copies that were there before, which stay as they are.

    A copy is signed: JupyterLab shows no drawing and runs no script of a notebook that it does not trust.
    """
    kept, notary = [], NotebookNotary()
    for file in notebook_files("ipynb").values():
        copy = folder / file.relative_to(NOTEBOOKS)
        if copy.exists():
            kept.append(copy)
        else:
            notebook = with_empty_answers(nbformat.read(file, as_version=4))
            notebook.metadata["jupytext"] = {"formats": "ipynb"}  # no source is paired with it
            text = nbformat.writes(notebook).replace("../results/", "results/")
            write_text(copy, text + "\n")
            notary.sign(nbformat.reads(text, as_version=4))
    for page in NOTEBOOKS.glob("*.md"):
        shutil.copy(page, folder)
    if not (folder / "results").exists():
        (folder / "results").symlink_to(RESULTS)  # JupyterLab opens nothing above its folder
    for plugin, setting in SETTINGS.items():
        write_text(folder / ".settings" / f"{plugin}.jupyterlab-settings", setting + "\n")
    return kept


def with_empty_answers(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """Put an empty cell before each solution, and fold the solution into a text that no run executes."""
    cells = []
    for cell in notebook.cells:
        if "solution" in cell.metadata.get("tags", []):
            cells.append(nbformat.v4.new_code_cell("# your answer", id=f"{cell.id}-answer"))
            text = f"<details><summary>Solution</summary>\n\n```python\n{cell.source}\n```\n\n</details>"
            metadata = {"tags": cell.metadata["tags"]}  # the text folds itself
            cell = nbformat.v4.new_markdown_cell(text, id=cell.id, metadata=metadata)
        cells.append(cell)
    notebook.cells = cells
    return notebook
