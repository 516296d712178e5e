import io
import re
from contextlib import redirect_stdout
from importlib import import_module

import joblib
import jupytext
import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot as plt

import workbook
from workbook.project import notebook_sources


def ignore(*shown, **how):
    """Show nothing."""


def tags_of(cell):
    return cell.metadata.get("tags", [])


class Running:
    """A notebook whose cells run in this process, faster and changed: its names, sentences and prints.

    A change is what a reader types, lines of parameters or an edit of the code, "old → new".
    """

    def __init__(self, monkeypatch, name, change):
        matplotlib.use("Agg")
        self.said, self.promises, self.parameters = [], [], {}
        old, edits, new = change.partition(" → ")
        if not edits:
            exec(change, {}, self.parameters)
        self.parameters = FASTER.get(name[:2], {}) | self.parameters

        instead = dict.fromkeys(("say_path", "say_times", "flipbook"), ignore)
        instead |= {
            "verdict": lambda text, *_, **__: self.said.append(text),
            "say": self.said.append,
            "show": lambda *named: self.said.append(named[-1]),
            "show_figure": lambda *named: self.said.append(named[-1]),
            "try_changing": lambda *changes: self.promises.extend(changes),
        }
        for function, replacement in instead.items():
            monkeypatch.setattr(workbook, function, replacement)
        self.names = {"display": ignore}
        (source,) = [path for each, path in notebook_sources().items() if each.startswith(name)]
        self.cells = [cell for cell in jupytext.read(source).cells if cell.cell_type == "code"]
        if edits:
            taught = [cell for cell in self.cells if "promises" not in tags_of(cell)]
            assert any(old in cell.source for cell in taught), f"no code {old}"
            for cell in taught:
                cell.source = cell.source.replace(old, new)

    def execute(self, cell):
        """Run a cell; return what it printed."""
        with redirect_stdout(io.StringIO()) as printed:
            exec(cell.source, self.names)
        plt.close("all")
        if "parameters" in tags_of(cell):
            assert set(self.parameters) <= set(self.names), "no such parameter"
            self.names |= self.parameters
        return printed.getvalue().strip()


@pytest.fixture
def on_simulated_records(monkeypatch):
    monkeypatch.setenv("BACKLASH_RECORDS", "simulated")


# With fewer runs what is foretold is the same, and so are the answers.
FASTER = {
    "03": {"alphas": [1e5]},
    "05": {"seeds": 2},
    "08": {"public": [1], "runs_each": 10},
    "09": {"benches": 5, "repeats": 2, "robots_each": 8, "couplings": [0.03]},
    "12": {"benches": 1, "realisations": [1], "levels": [3, 7, 11]},
    "14": {"bits": [19]},
}
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
def computed_once(monkeypatch, tmp_path):
    """Let each of these functions compute what it is asked for once, in all runs of a notebook."""
    memory = joblib.Memory(tmp_path, verbose=0)
    for module, names in COMPUTED_ONCE.items():
        for name in names:
            function = getattr(import_module(module), name)
            monkeypatch.setattr(f"{module}.{name}", memory.cache(function))


@pytest.fixture
def run_notebook(monkeypatch, computed_once):
    """Run a notebook but for its exercises, with a change; returns the run."""

    def run(name, change=""):
        running = Running(monkeypatch, name, change)
        for cell in running.cells:
            running.execute(cell)
            if "promises" in tags_of(cell):
                return running

    return run


def exercise_of(check):
    """Name of the answer that a check takes, and the precision that it asks for; None for a whole number."""
    answer = re.search(r"check_answer\(\s*(\w+),", check)[1]
    precision = re.search(r"\bto=([\d.]+)", check)
    return answer, precision and precision[1]


@pytest.fixture
def answer_exercises(monkeypatch, on_simulated_records):
    """Run a lab copy with its solutions; returns what the check of each exercise says of other answers.

    Answers are in words of the notebook, of what is `right` there, and of `off`, by which an answer is just wrong.
    """

    def run(name, answers, change=""):
        running, said = Running(monkeypatch, name, change), {}
        for cell in running.cells:
            if "solution" in tags_of(cell):
                solution = cell
            elif "check" in tags_of(cell):
                assert running.execute(cell) == "", "said where there is no answer"
                running.execute(solution)
                exercise, precision = exercise_of(cell.source)
                right = np.asarray(running.names[exercise], dtype=float)[()]
                to = float(precision or 1)
                words = {"right": right, "to": to, "off": 1.6 * to if precision else 1}
                said[exercise] = {}
                for answer in answers(exercise):
                    running.names[exercise] = eval(answer, running.names | words)
                    said[exercise][answer] = running.execute(cell).partition(":")[0]
            else:
                running.execute(cell)
        return said

    return run
