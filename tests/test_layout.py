"""Imports go one way: among the packages, and the paper's files in the order of reading."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# What each package may import of the others.
MAY_IMPORT = {
    "replication": set(),
    "backlash": {"replication"},
    "workbook": {"replication"},
    "studies": {"replication", "backlash"},
}
READ_IN_ORDER = (
    *("published", "signature", "misfit", "cmaes", "joint", "records", "table2"),
    *("characteristic", "identification", "bench", "figures"),
)


def imported(file: Path) -> set[str]:
    """What a file imports of the project, at the top or in a function."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{name.name}" for name in node.names}
        elif isinstance(node, ast.Import):
            names |= {name.name for name in node.names}
    return {name for name in names if name.partition(".")[0] in MAY_IMPORT}


def module_of(file: Path) -> str:
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@pytest.fixture(scope="module")
def imports() -> dict[str, set[str]]:
    files = (file for package in MAY_IMPORT for file in (ROOT / package).rglob("*.py"))
    return {module_of(file): imported(file) for file in files}


def test_a_package_imports_only_those_below_it(imports):
    for module, names in imports.items():
        package = module.partition(".")[0]
        assert {name.partition(".")[0] for name in names} - {package} <= MAY_IMPORT[package], module


def test_a_notebook_of_the_paper_imports_the_papers_package_and_the_workbook():
    for notebook in (ROOT / "notebooks").glob("[0-9]*.py"):
        packages = {name.partition(".")[0] for name in imported(notebook)}
        assert packages <= {"replication", "workbook"}, notebook.name


def test_a_file_of_the_paper_imports_only_those_before_it(imports):
    for position, name in enumerate(READ_IN_ORDER):
        names = {each.split(".")[1] for each in imports[f"replication.{name}"]}
        assert not names & {*READ_IN_ORDER[position:]} - {name}, name
