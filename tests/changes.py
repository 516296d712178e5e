"""Changes that notebooks propose, and a notebook run in this process with a change."""

import ast
import re

import matplotlib.pyplot as plt
import pytest

from workbook import execution
from workbook.checkout import notebook_files

NOTEBOOKS = notebook_files("py")

# What an outcome is checked with, where the quick run is still long. A change's own parameter comes last.
CHEAPER = {
    "08_noise_table2": {"public": [1, 2]},
    "10_bench_table3": {"benches": 20},
    "11_robots_table4": {"robots_each": 100, "loud_robots_each": 50, "frequency_step_hz": 10.0},
    "13_readings_compared": {"scored": [3]},
    "15_protocols": {"made_again": 1},
    "16_claims": {"noises": 4, "noise_seeds": 40, "mountings": 1, "bits": [16, 19]},
    "18_the_stored_runs": {"rows": [3, 9], "seed_runs": 1, "today_runs": 1},
    "19_friction": {"shares": [0.0, 0.005, 0.05, 0.1]},
    "20_another_optimiser": {"strategy_runs": 1, "budget": 3000},
}


def changes(notebook):
    """Changes that a notebook proposes, as written."""
    cells = execution.read_notebook(NOTEBOOKS[notebook]).cells
    text = next(cell.source for cell in cells if cell.source.startswith("## Try changing"))
    return [match[1] for line in text.splitlines() if (match := re.match(r"\d\. `([^`]+)`", line))]


def parse(change):
    (assignment,) = ast.parse(change).body
    return {assignment.targets[0].id: ast.literal_eval(assignment.value)}


def run(notebook, parameters, folder, edits=None):
    """Run a notebook's cells here, with few repeats and some of its lines edited; return its variables."""
    source = execution.read_notebook(NOTEBOOKS[notebook])
    for line, edited in (edits or {}).items():
        (cell,) = (cell for cell in source.cells if cell.source.count(line) == 1)
        cell.source = cell.source.replace(line, edited)
    values = execution.quick_parameters(source) | CHEAPER.get(notebook, {}) | parameters
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("REPLICATION_OUT", str(folder))
        patch.setenv("REPLICATION_NOTEBOOK", notebook)
        patch.setenv("REPLICATION_QUICK", "1")
        variables = _execute(execution.with_parameters(source, values).cells, notebook)
    plt.close("all")
    return variables


def check(notebook, parameters):
    """Run a notebook's cells up to the one that checks its parameters; the others have their own values."""
    cells = execution.with_parameters(
        execution.read_notebook(NOTEBOOKS[notebook]), parameters
    ).cells
    last = next(k for k, cell in enumerate(cells) if "check_parameters(" in cell.source)
    _execute(cells[: last + 1], notebook)


def _execute(cells, name):
    variables = {"display": lambda shown: variables.setdefault("displayed", []).append(shown)}
    for cell in cells:
        if cell.cell_type == "code":
            exec(compile(cell.source, name, "exec"), variables)
    return variables


def says_what_happened(printed, changed=()):
    """Whether a notebook prints a sentence, not numbers alone, and names in it every parameter that was changed."""
    return any(
        len(line) > 60 and all(f"`{name} = " in line for name in changed)
        for line in printed.splitlines()
    )
