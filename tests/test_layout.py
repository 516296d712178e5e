"""Imports go one way: among the packages, and the paper's files in the order of reading; none is made too early."""

import ast
import inspect
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from replication import EQUATIONS, NOT_OF_THE_PAPER, READING_ORDER

ROOT = Path(__file__).resolve().parents[1]
# What each package may import of the others.
MAY_IMPORT = {
    "replication": set(),
    "backlash": {"replication"},
    "workbook": {"replication"},
    "studies": {"replication", "backlash"},
}


def imported(file: Path) -> set[str]:
    """What a file imports of the project, at the top or in a function."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{name.name}" for name in node.names}
        elif isinstance(node, ast.Import):
            names |= {name.name for name in node.names}
    return {name for name in names if name.partition(".")[0] in MAY_IMPORT}


def modules(package: str) -> dict[str, set[str]]:
    """What each file of a package imports."""
    return {str(file): imported(file) for file in (ROOT / package).rglob("*.py")}


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_a_package_imports_only_those_below_it(package):
    for file, names in modules(package).items():
        assert {name.partition(".")[0] for name in names} <= MAY_IMPORT[package] | {package}, file


def test_the_machine_imports_of_ours_what_reads_and_writes_files_alone():
    for file, names in modules("workbook").items():
        ours = {name for name in names if not name.startswith("workbook")}
        assert all(name.startswith("replication.files") for name in ours), file


def test_a_notebook_of_the_paper_imports_the_papers_package_the_workbook_and_studies():
    for notebook in (ROOT / "notebooks").glob("[0-9]*.py"):
        packages = {name.partition(".")[0] for name in imported(notebook)}
        assert packages <= {"replication", "workbook", "studies"}, notebook.name


def test_the_order_of_reading_has_every_file_of_the_paper():
    files = {file.stem for file in (ROOT / "replication").glob("*.py")} - {"__init__"}
    assert files == {*READING_ORDER, *NOT_OF_THE_PAPER}


@pytest.mark.parametrize("position", range(len(READING_ORDER)))
def test_a_file_of_the_paper_imports_only_those_before_it_and_what_reads_and_compiles(position):
    own = READING_ORDER[position]
    names = {name.split(".")[1] for name in imported(ROOT / "replication" / f"{own}.py")}
    assert names <= {*READING_ORDER[:position], "files", "compilation"}


@pytest.mark.parametrize("number", range(1, 20))
def test_each_equation_stands_where_the_index_says_under_its_number(number):
    module, function = EQUATIONS[number].split(".")
    source = inspect.getsource(getattr(import_module(f"replication.{module}"), function))
    # Equations 1 to 4 are 5 to 7 in absolute times.
    assert re.search(rf"(?i:equation) {number if number > 4 else r'[567]'}\b", source)


@pytest.mark.parametrize("command", ["backlash", "workbook"])
def test_help_loads_no_library_that_computes(command):
    """So it is there at once, and the thread limit is set before NumPy reads it."""
    code = f"""
import runpy, sys
sys.argv = ["{command}", "--help"]
try:
    runpy.run_module("{command}", run_name="__main__")
except SystemExit:
    print("loaded:", *{{"numpy", "pandas", "scipy", "numba", "matplotlib"}} & sys.modules.keys())
"""
    ran = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert ran.stdout.startswith("usage:")
    assert ran.stdout.endswith("loaded:\n")
