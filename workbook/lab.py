"""JupyterLab at the student's copies of the notebooks in `lab/`: what is saved there touches no committed notebook."""

import os
import platform
import shutil
import sys
from pathlib import Path

import nbformat
from nbformat.sign import NotebookNotary

from replication.files import DataUnavailable, write_text
from workbook.project import ROOT, SIMULATED, find_hook, notebook_sources

NOTEBOOKS, LAB = ROOT / "notebooks", ROOT / "lab"
# JupyterLab is not to ask for news and updates.
SETTINGS = '{"fetchNews": "false", "checkForUpdates": false}\n'


def copy_notebooks(folder: Path = LAB) -> list[Path]:
    """Copy the executed notebooks; return the copies that were there before, which stay as they are.

    A copy is signed: JupyterLab shows no drawing and runs no script of a notebook that it does not trust.
    """
    kept, notary = [], NotebookNotary()
    for source in notebook_sources().values():
        executed = source.with_suffix(".ipynb")
        copy = folder / executed.relative_to(NOTEBOOKS)
        if copy.exists():
            kept.append(copy)
            continue
        notebook = nbformat.read(executed, as_version=4)
        for cell in notebook.cells:
            ask_for_answer(cell)
        # What a kernel says of itself when it starts: else JupyterLab calls an untouched copy unsaved.
        notebook.metadata.setdefault("language_info", {})["version"] = platform.python_version()
        notebook.metadata["jupytext"] = {"formats": "ipynb"}  # no source is paired with it
        write_text(copy, nbformat.writes(notebook) + "\n")
        notary.sign(notebook)
    for page in (*NOTEBOOKS.glob("*.md"), *NOTEBOOKS.glob("*.html")):
        shutil.copy(page, folder)
    settings = folder / ".settings" / "@jupyterlab" / "apputils-extension"
    write_text(settings / "notification.jupyterlab-settings", SETTINGS)
    return kept


def start() -> None:
    """Become JupyterLab at the copies, with arithmetic as `python -m workbook run` has it: the same digits.

    Where data can't be had the copies run on simulated ones, if the project has such.
    """
    try:
        for name in find_hook("checksums", dict)():
            find_hook("fetch")(name)
    except DataUnavailable as missing:
        instead = "simulated ones take" if SIMULATED else "nothing takes"
        print(f"{missing}; until then {instead} their place")
        if SIMULATED:
            os.environ[SIMULATED["variable"]] = "simulated"
    os.environ |= find_hook("environment", dict)() | {
        "JUPYTERLAB_SETTINGS_DIR": str(LAB / ".settings")
    }
    first = sorted(LAB.glob("[0-9]*.ipynb"))[0].relative_to(ROOT)
    command = [sys.executable, "-m", "jupyterlab", f"--LabApp.default_url=/lab/tree/{first}"]
    if os.getuid() == 0:
        command.append("--allow-root")
    os.chdir(ROOT)
    os.execv(command[0], command)


def ask_for_answer(cell: nbformat.NotebookNode) -> None:
    """Leave nothing of a solution, and of the check of an answer no output."""
    tags = cell.metadata.get("tags", [])
    if "solution" in tags:
        cell.source, cell.metadata = "# Your answer:", {}
    if {"solution", "check"}.intersection(tags):
        cell.outputs, cell.execution_count = [], None
