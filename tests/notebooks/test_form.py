"""What every notebook has: checked parameters, tested exercises, the equations it uses, and an executed copy."""

import re

import nbformat
import pytest

from workbook import execution
from workbook.checkout import notebook_files

HEADINGS = ["Claim", "Method", "Parameters", "Result", "Verdict", "Try changing", "Exercises"]
SOURCES = notebook_files("py")


def tags(cell):
    return set(cell.metadata.get("tags", []))


def cells(name, kind="code"):
    return [cell for cell in execution.read_notebook(SOURCES[name]).cells if cell.cell_type == kind]


def text(name):
    return "\n".join(cell.source for cell in cells(name, "markdown"))


@pytest.mark.parametrize("name", SOURCES)
def test_a_notebook_has_its_headings_and_three_solutions_that_test_their_answers(name):
    assert re.findall(r"^## (.+)$", text(name), re.MULTILINE) == HEADINGS
    solutions = [cell.source for cell in cells(name) if "solution" in tags(cell)]
    assert len(solutions) == 3
    assert all(re.search(r"^\s*assert ", source, re.MULTILINE) for source in solutions)


@pytest.mark.parametrize("name", SOURCES)
def test_a_notebook_has_one_parameters_cell_and_what_follows_checks_every_parameter(name):
    code = cells(name)
    (position,) = [k for k, cell in enumerate(code) if "parameters" in tags(cell)]
    assigned = re.findall(r"^(\w+) = ", code[position].source, re.MULTILINE)
    checked = re.findall(r"\b(\w+)=\(", code[position + 1].source)
    assert set(assigned) <= set(checked), "not checked"


@pytest.mark.parametrize("name", SOURCES)
def test_a_quick_run_changes_parameters_that_its_notebook_has(name):
    notebook = execution.read_notebook(SOURCES[name])
    execution.with_parameters(notebook, execution.quick_parameters(notebook))


@pytest.mark.parametrize("name", SOURCES)
def test_the_executed_notebook_beside_a_source_has_its_cells_and_no_error(name):
    executed = nbformat.read(SOURCES[name].with_suffix(".ipynb"), as_version=4)
    source = execution.read_notebook(SOURCES[name])
    assert [cell.source for cell in executed.cells] == [cell.source for cell in source.cells]
    outputs = [out for cell in executed.cells for out in cell.get("outputs", [])]
    assert outputs
    assert all(out.output_type != "error" for out in outputs)
    assert " at 0x" not in str(outputs), "an object's address, which changes from run to run"
