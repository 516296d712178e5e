import io
import re
from contextlib import redirect_stdout
from copy import deepcopy

import IPython.display
import jupytext
import matplotlib
import numpy as np
import pytest

import workbook
from replication.files import ROOT
from workbook import lab


class Running:
    """A notebook whose cells run in this process, with other parameters: its names, verdict and what it printed."""

    def __init__(self, monkeypatch, name, parameters):
        matplotlib.use("Agg")
        monkeypatch.setenv("BACKLASH_RECORDS", "simulated")
        self.verdicts, self.printed, self.parameters = [], io.StringIO(), parameters
        self.names = {"display": lambda *shown, **how: None}
        monkeypatch.setattr(workbook, "verdict", lambda text, *_, **__: self.verdicts.append(text))
        monkeypatch.setattr(IPython.display, "display", lambda *shown, **how: None)
        monkeypatch.setattr(workbook, "flipbook", lambda *drawn: None)
        (source,) = (ROOT / "notebooks").glob(f"**/{name}*.py")
        cells = jupytext.read(source).cells
        self.cells = [cell for cell in cells if cell.cell_type == "code"]

    def execute(self, cell):
        """Run a cell; return what it printed."""
        start = self.printed.tell()
        with redirect_stdout(self.printed):
            exec(cell.source, self.names)
        if "parameters" in cell.metadata.get("tags", []):
            assert set(self.parameters) <= set(self.names), "no such parameter"
            self.names |= self.parameters
        return self.printed.getvalue()[start:].strip()


@pytest.fixture
def run_notebook(monkeypatch):
    """Run a notebook with other parameters; returns its names, verdict and what it printed."""

    def run(name, **parameters):
        running = Running(monkeypatch, name, parameters)
        for cell in running.cells:
            running.execute(cell)
        return running.names, running.verdicts[0], running.printed.getvalue()

    return run


@pytest.fixture
def answer_exercises(monkeypatch):
    """Run a lab copy; returns what each check says of no answer, the solution, 1.5 times the solution, and a text."""

    def run(name, **parameters):
        running, said = Running(monkeypatch, name, parameters), []
        source = "\n".join(cell.source for cell in running.cells)
        names = re.search(r"^((?:\w+ = )+)\S+  # your answers", source, re.MULTILINE)[1].split(
            " = "
        )
        for cell in running.cells:
            tags = cell.metadata.get("tags", [])
            if "solution" in tags:
                solution, stripped = cell, deepcopy(cell)
                lab.ask_for_answer(stripped)
                running.execute(stripped)
            elif "check" in tags:
                answer = names[len(said)]
                blank = running.execute(cell)
                running.execute(solution)
                right = running.names[answer]
                of_solution = running.execute(cell)
                running.names[answer] = np.multiply(1.5, right)
                of_wrong = running.execute(cell)
                running.names[answer] = "one"
                said.append([blank, of_solution, of_wrong, running.execute(cell)])
                running.names[answer] = right
            else:
                running.execute(cell)
        return said

    return run
