"""The paper's files import each other in the order in which they are read."""

import ast

import pytest

from replication.files import ROOT

READ_IN_ORDER = (
    "signature",
    "misfit",
    "bounds",
    "cmaes",
    "stopping",
    "records",
    "table2",
    "table2_claims",
    "characteristic",
    "dead_zone",
    "standins",
    "sources",
)
SIMULATOR = sorted((ROOT / "replication" / "simulator").glob("*.py"))


def modules_of_the_paper(file):
    """First names below `replication` that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module == "replication":
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("replication."):
            found.add(node.module.split(".")[1])
    return found


@pytest.mark.parametrize("number", range(len(READ_IN_ORDER)))
def test_a_file_of_the_paper_imports_only_those_before_it(number):
    found = modules_of_the_paper(ROOT / "replication" / f"{READ_IN_ORDER[number]}.py")
    assert not found & set(READ_IN_ORDER[number:])


@pytest.mark.parametrize("file", SIMULATOR, ids=lambda file: file.stem)
def test_the_simulated_joint_knows_nothing_of_the_signature_and_its_search(file):
    assert modules_of_the_paper(file) & set(READ_IN_ORDER) <= {"records"}
