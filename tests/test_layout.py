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
# What the files of each room may import of the project.
MAY_IMPORT = {
    "replication/**/*.py": ("replication",),
    "backlash/**/*.py": ("backlash", "replication"),
    "workbook/**/*.py": ("workbook", "replication.files"),  # what reads and writes files alone
    "studies/**/*.py": ("studies", "replication", "backlash"),
    "notebooks/*.py": ("replication", "workbook", "studies"),  # of the paper
}
OURS = ("replication", "backlash", "workbook", "studies")


def imported(file: Path) -> set[str]:
    """What a file imports of the project, at the top or in a function."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{name.name}" for name in node.names}
        elif isinstance(node, ast.Import):
            names |= {name.name for name in node.names}
    return {name for name in names if name.startswith(OURS)}


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_a_file_imports_only_what_its_room_may(room):
    files = [*ROOT.glob(room)]
    assert files
    for file in files:
        assert all(name.startswith(MAY_IMPORT[room]) for name in imported(file)), file


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
