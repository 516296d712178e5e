import copy
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
    """A notebook whose cells run in this process, changed: its names, sentences, verdict and what it printed."""

    def __init__(self, monkeypatch, name, parameters, edit):
        matplotlib.use("Agg")
        self.verdicts, self.said, self.promises = [], [], []
        self.printed, self.parameters = io.StringIO(), parameters

        def show(*named):
            *_, figure, text = named
            plt.close(figure)
            self.said.append(text)

        instead = dict.fromkeys(("say_path", "say_times", "flipbook"), ignore)
        instead |= {
            "verdict": lambda text, *_, **__: self.verdicts.append(text),
            "say": self.said.append,
            "show": show,
            "show_figure": show,
            "try_changing": lambda *changes: self.promises.extend(changes),
        }
        for function, replacement in instead.items():
            monkeypatch.setattr(workbook, function, replacement)
        self.names = {"display": ignore}
        (source,) = [path for each, path in notebook_sources().items() if each.startswith(name)]
        self.cells = [cell for cell in jupytext.read(source).cells if cell.cell_type == "code"]
        if edit[0]:
            taught = [cell for cell in self.cells if "promises" not in tags_of(cell)]
            assert any(edit[0] in cell.source for cell in taught), f"no code {edit[0]}"
            for cell in taught:
                cell.source = cell.source.replace(*edit)

    def execute(self, cell):
        """Run a cell; return what it printed."""
        start = self.printed.tell()
        with redirect_stdout(self.printed):
            exec(cell.source, self.names)
        if "parameters" in tags_of(cell):
            assert set(self.parameters) <= set(self.names), "no such parameter"
            self.names |= self.parameters
        return self.printed.getvalue()[start:].strip()

    def execute_to(self, last):
        """Run the cells up to the first one with a tag."""
        for cell in self.cells:
            self.execute(cell)
            if last in tags_of(cell):
                return


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
def run_notebook(monkeypatch, computed_once):
    """Run a notebook but for its exercises, with parameters, else faster, as a change has it; returns the run."""

    def run(name, parameters=None, code=""):
        old, _, new = code.partition(" → ")
        changed = {}
        if not new:
            exec(code, {}, changed)
        given = FASTER.get(name[:2], {}) if parameters is None else parameters
        running = Running(monkeypatch, name, given | changed, (old, new) if new else ("", ""))
        running.execute_to("promises")
        return running

    return run


@pytest.fixture
def answer_exercises(monkeypatch, on_simulated_records):
    """Run a lab copy with its solutions; returns what the check of each exercise says of other answers."""

    def run(name, answers, edit=("", "")):
        running, asked, said = Running(monkeypatch, name, FASTER.get(name, {}), edit), {}, {}
        source = "\n".join(cell.source for cell in running.cells)
        line = re.search(r"^((?:\w+ = )+)\S+  # your answers", source, re.MULTILINE)[1]
        exercises = iter(line.split(" = "))
        check_answer = workbook.check_answer

        def spy(answer, expected, to=0.0):
            asked["to"] = to
            check_answer(answer, expected, to)

        monkeypatch.setattr(workbook, "check_answer", spy)
        for cell in running.cells:
            if "solution" in tags_of(cell):
                solution = cell
            elif "check" in tags_of(cell):
                exercise = next(exercises)
                assert running.execute(cell) == "", "said where there is no answer"
                running.execute(solution)
                running.execute(cell)
                said[exercise] = {
                    answer: answer_exercise(running, exercise, cell, value)
                    for answer, value in values_of(answers(exercise), running, exercise, **asked)
                }
            else:
                running.execute(cell)
        return said

    return run


def values_of(answers, running, exercise, to):
    """Answers in words of a notebook, of what is `right` there, and of `off`, by which an answer is just wrong."""
    right = np.asarray(running.names[exercise], dtype=float)[()]
    words = running.names | {"right": right, "to": to or 1.0, "off": 1.6 * to or 1.0}
    return [(answer, np.asarray(eval(answer, words), dtype=float)[()]) for answer in answers]


def answer_exercise(running, exercise, check, value):
    """What a check says of an answer."""
    running.names[exercise] = value
    return running.execute(check).partition(":")[0]
