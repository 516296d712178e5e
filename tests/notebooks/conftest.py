import copy
import io
import re
from contextlib import redirect_stdout
from importlib import import_module
from types import SimpleNamespace

import IPython.display
import joblib
import jupytext
import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot as plt

import workbook
from workbook import lab
from workbook.project import notebook_sources


class Running:
    """A notebook whose cells run in this process, changed: its names, sentences, verdict and what it printed."""

    def __init__(self, monkeypatch, name, parameters=(), edit=("", "")):
        matplotlib.use("Agg")
        self.verdicts, self.said, self.promises, self.answers = [], [], [], []
        self.printed, self.parameters = io.StringIO(), dict(parameters)
        self.names = {"display": lambda *shown, **how: None}
        instead = {
            "verdict": lambda text, *_, **__: self.verdicts.append(text),
            "say": self.said.append,
            "say_times": lambda name: None,
            "show": lambda figure, text: self.said.append(text) or plt.close(figure),
            "show_figure": lambda name, figure, text: self.said.append(text) or plt.close(figure),
            "flipbook": lambda *drawn: None,
            "try_changing": lambda *changes: self.promises.extend(changes),
        }
        for function, replacement in instead.items():
            monkeypatch.setattr(workbook, function, replacement)
        monkeypatch.setattr(IPython.display, "display", lambda *shown, **how: None)
        (source,) = [path for each, path in notebook_sources().items() if each.startswith(name)]
        self.cells = [cell for cell in jupytext.read(source).cells if cell.cell_type == "code"]
        if edit[0]:
            taught = [
                cell for cell in self.cells if "promises" not in cell.metadata.get("tags", [])
            ]
            assert any(edit[0] in cell.source for cell in taught), f"no code {edit[0]}"
            for cell in taught:
                cell.source = cell.source.replace(*edit)

    def execute(self, cell):
        """Run a cell; return what it printed."""
        start = self.printed.tell()
        with redirect_stdout(self.printed):
            exec(cell.source, self.names)
        if "parameters" in cell.metadata.get("tags", []):
            assert set(self.parameters) <= set(self.names), "no such parameter"
            self.names |= self.parameters
        return self.printed.getvalue()[start:].strip()

    def execute_to(self, last):
        """Run the cells up to the first one with a tag."""
        for cell in self.cells:
            self.execute(cell)
            if last in cell.metadata.get("tags", []):
                return


@pytest.fixture
def on_simulated_records(monkeypatch):
    monkeypatch.setenv("BACKLASH_RECORDS", "simulated")


@pytest.fixture
def run_notebook(monkeypatch, on_simulated_records):
    """Run a notebook with other parameters; returns its names, verdict and what it printed."""

    def run(name, **parameters):
        running = Running(monkeypatch, name, parameters)
        for cell in running.cells:
            running.execute(cell)
        return running.names, running.verdicts[0], running.printed.getvalue()

    return run


# What takes long, and a change seldom touches.
COMPUTED_ONCE = {
    "backlash": ["estimate"],
    "replication.best_fit": ["best_fit"],
    "replication.joint": ["simulate"],
    "replication.records": ["load_noisy"],
    "replication.table2": ["fit", "repeated_fits"],
    "studies.claims": ["measure_dead_zone", "measure_records", "measure_table2"],
    "studies.experiments": ["amplitudes_without_backlash", "bits_study", "friction_study"],
    "studies.identification": ["identify_joint"],
    "studies.multiverse": ["make_multiverse"],
    "studies.standins": ["fit_logs", "table3", "table4"],
    "studies.edge": ["stepping_torque_study"],
    "studies.replay": ["replay_stored_runs"],
}


@pytest.fixture
def computed_once(monkeypatch):
    """Let each of these functions compute what it is asked for once, in all runs of a notebook."""
    for module, names in COMPUTED_ONCE.items():
        for name in names:
            function = getattr(import_module(module), name)
            monkeypatch.setattr(f"{module}.{name}", compute_once(function))


def compute_once(function):
    answers = {}

    def computed_once(*args, **options):
        asked = joblib.hash((args, options))
        if asked not in answers:
            answers[asked] = function(*args, **options)
        return copy.deepcopy(answers[asked])

    return computed_once


@pytest.fixture
def run_to_promises(monkeypatch, computed_once):
    """Run a notebook without its exercises, with other parameters, then as a change has it; returns the run."""

    def run(name, parameters=(), code=""):
        old, _, new = code.partition(" → ")
        changed = {}
        if not new:
            exec(code, {}, changed)
        running = Running(
            monkeypatch, name, dict(parameters) | changed, (old, new) if new else ("", "")
        )
        running.execute_to("promises")
        return running

    return run


@pytest.fixture
def answer_exercises(monkeypatch, on_simulated_records):
    """Run a lab copy with its solutions; returns what the check of each exercise says, of other answers too."""

    def run(name, others, edit=("", ""), **parameters):
        running, exercises = Running(monkeypatch, name, parameters, edit), []
        source = "\n".join(cell.source for cell in running.cells)
        line = re.search(r"^((?:\w+ = )+)\S+  # your answers", source, re.MULTILINE)[1]
        names = line.split(" = ")
        asked = {}
        check_answer = workbook.check_answer

        def spy(answer, expected, to=0.0):
            asked.update(expected=expected, to=to)
            check_answer(answer, expected, to)

        monkeypatch.setattr(workbook, "check_answer", spy)
        for cell in running.cells:
            tags = cell.metadata.get("tags", [])
            if "solution" in tags:
                solution = cell
            elif "check" in tags:
                answer = names[len(exercises)]
                stripped = solution.copy()
                lab.ask_for_answer(stripped)
                tried = others.get(answer, {})
                exercises.append(
                    answer_exercise(running, answer, stripped, solution, cell, asked, tried)
                )
            else:
                running.execute(cell)
        return exercises

    return run


def answer_exercise(running, name, stripped, solution, check, asked, others):
    """What a check says of no answer, of the solution, near misses, honest roundings, and of others, as code."""
    assert running.execute(stripped) == ""
    blank = running.execute(check)
    running.execute(solution)
    right = np.asarray(running.names[name], dtype=float)
    of_solution = running.execute(check)
    to = asked["to"]

    def of(answers):
        said = []
        for answer in answers:
            running.names[name] = answer[()]
            said.append(running.execute(check).partition(":")[0])
        running.names[name] = right[()]
        return said

    unit = to or 1.0
    roundings = [to * np.round(right / to), to * np.trunc(right / to)] if to else [right, right]
    misses = [right + 1.6 * unit, right - 1.6 * unit, right + 37 * unit]
    if not to:
        misses += [right + 0.36, right + 1]
    running.names[name] = "one"
    of_word = running.execute(check)
    known = running.names | {name: right[()], "right": right[()]}
    values = [np.asarray(eval(other, known), dtype=float) for other in others]
    return SimpleNamespace(
        name=name,
        to=to,
        blank=blank,
        of_solution=of_solution,
        of_roundings=of(roundings),
        of_misses=of(misses),
        of_word=of_word,
        of_others=dict(zip(others, of(values), strict=True)),
    )
