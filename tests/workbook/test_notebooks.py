"""What every notebook has: checked parameters, and an executed copy of the same cells."""

import ast
import re

import jupytext
import nbformat
import pytest

from workbook.project import notebook_sources

SOURCES = notebook_sources()


def read_code(name):
    """The cells of code of a source."""
    return [cell for cell in jupytext.read(SOURCES[name]).cells if cell.cell_type == "code"]


def is_check(node):
    """Whether a piece of code calls `workbook.check_parameters`."""
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "workbook.check_parameters"


@pytest.mark.parametrize("name", SOURCES)
def test_a_notebook_has_one_parameters_cell_and_the_next_checks_every_parameter(name):
    code = read_code(name)
    (position,) = [
        k for k, cell in enumerate(code) if "parameters" in cell.metadata.get("tags", [])
    ]
    assigned = re.findall(r"^(\w+) = ", code[position].source, re.MULTILINE)
    calls = [each for each in ast.walk(ast.parse(code[position + 1].source)) if is_check(each)]
    assert set(assigned) <= {keyword.arg for each in calls for keyword in each.keywords}


@pytest.mark.parametrize("name", SOURCES)
def test_no_line_of_code_scrolls_sideways_in_a_page_of_the_book(name):
    code = "\n".join(cell.source for cell in read_code(name))
    assert re.findall(r".{85,}", code) == []


@pytest.mark.parametrize("name", SOURCES)
def test_the_executed_notebook_has_the_cells_of_its_source_and_no_error(name):
    executed = nbformat.read(SOURCES[name].with_suffix(".ipynb"), as_version=4)
    cells = jupytext.read(SOURCES[name]).cells
    assert [cell.source for cell in executed.cells] == [cell.source for cell in cells]
    outputs = [output for cell in executed.cells for output in cell.get("outputs", [])]
    assert outputs
    assert all(output.output_type != "error" for output in outputs)
    assert " at 0x" not in str(outputs), "an object's address, which changes from run to run"
