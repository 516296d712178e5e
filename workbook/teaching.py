"""What a notebook says to a student: its times, findings, changes to try, and whether an answer is right."""

import ast
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from workbook.outcomes import read_kept, say
from workbook.parameters import is_number
from workbook.project import notebook_sources

# A model of a slow reader.
WORDS_PER_MINUTE = 150
LINES_PER_MINUTE = 12  # of code that is not folded
EQUATION_MINUTES = 1.0
SHOWN_MINUTES = 0.5  # a figure or a table
EXERCISE_MINUTES = 5
FOLDED = {"hide-input", "hide-cell", "remove-input"}
EXERCISE = {"solution", "check"}
EQUATION = re.compile(r"\$\$.*?\$\$", re.DOTALL)
FIGURES = re.compile(r"workbook\.(?:show|show_figure|flipbook)\(")


def _read_cells(name: str) -> list[Any]:
    import jupytext  # slow to import

    return jupytext.read(notebook_sources()[name]).cells


def reading_minutes(name: str) -> float:
    """How long a reader takes for a notebook without its exercises: words, visible code, equations, figures, tables."""
    return sum(map(_cell_minutes, _read_cells(name)))


def _cell_minutes(cell: Any) -> float:
    tags = set(cell.metadata.get("tags", []))
    if cell.cell_type == "markdown":
        equations = EQUATION.findall(cell.source)
        words = EQUATION.sub("", cell.source).split()
        return len(words) / WORDS_PER_MINUTE + len(equations) * EQUATION_MINUTES
    if tags & EXERCISE:
        return 0.0
    tree = ast.parse(cell.source)
    constants = [each.value for each in ast.walk(tree) if isinstance(each, ast.Constant)]
    texts = [each.split() for each in constants if isinstance(each, str) and each.count(" ") > 2]
    lines = [] if tags & FOLDED else [line for line in cell.source.splitlines() if line.strip()]
    # A value at the end is a table, but for a call that shows something itself.
    last = tree.body[-1]
    is_call = ast.unparse(last).startswith(("workbook.", "print("))
    shows_table = isinstance(last, ast.Expr) and not is_call
    shown = len(FIGURES.findall(cell.source)) + shows_table
    minutes = sum(map(len, texts)) / WORDS_PER_MINUTE + len(lines) / LINES_PER_MINUTE
    return minutes + SHOWN_MINUTES * shown


def say_times(name: str) -> None:
    """Say how long a notebook takes to read, by a model, and to run, as measured (`results/notebook_times.csv`)."""
    measured = read_kept("notebook_times").set_index("notebook")["seconds"]
    half_minutes = -(-measured.get(name, np.nan) // 30)
    run = f"{half_minutes / 2:g} min" if half_minutes > 0 else "not measured"
    say(f"*Reading time: {reading_minutes(name):.0f} min. Run time: {run}.*")


def say_path(*names: str) -> None:
    """Say how long the notebooks of a path take together, by the same model, and how long their exercises."""
    hours = sum(map(reading_minutes, names)) / 60
    cells = [cell for name in names for cell in _read_cells(name)]
    exercises = sum("solution" in cell.metadata.get("tags", []) for cell in cells)
    say(
        f"*The path in all: {hours:.1f} h to read, and {exercises * EXERCISE_MINUTES / 60:.1f} h for its {exercises} "
        f"exercises, if one takes {EXERCISE_MINUTES} min.*"
    )


def try_changing(*changes: tuple[str, str, Callable[[Any, Any], bool]]) -> None:
    """Show changes that a student is asked to try, and what each does: a promise, which a test keeps.

    A change has its code, parameters that are set, or code and what replaces it with an arrow between them; what then
    happens, in words; and whether it does, of the names of the changed and of the unchanged run.
    """
    say("\n".join(f"{k}. `{code}`: {then}" for k, (code, then, _) in enumerate(changes, 1)))


def check_answer(answer: Any, expected: Any, to: float = 0.0) -> None:
    """Print "right" or "not yet", or which part of an answer is no number; nothing while it is nan.

    Parameters
    ----------
    answer : number or numbers
        nan stands for no answer yet.
    expected : number, numbers or function
        What is right; or a condition of a number.
    to : float
        The precision that the exercise asks for: an answer may lie so far off. 0: it asks for a whole number.
    """
    given = np.array(answer, dtype=object)
    for place, each in np.ndenumerate(given):
        if isinstance(each, complex) and each.imag == 0:  # as the roots of a polynomial are given
            given[place] = each.real
    if wrong := [each for each in given.flat if not is_number(each)]:
        print(f"not yet: {wrong[0]!r} is not a number")
        return
    if given.size == 1 and np.ndim(expected) == 0:  # as solvers return one number
        given = given.reshape(())
    numbers = given.astype(float)[()]
    if np.isnan(numbers).any():
        return
    if to == 0 and (numbers % 1 != 0).any():
        print("not yet: a whole number is asked for")
        return
    is_right = given.shape == np.shape(expected)
    if is_right and callable(expected):
        is_right = bool(expected(numbers))
    elif is_right:
        is_right = np.allclose(numbers, expected, rtol=0, atol=to * (1 + 1e-9))
    print("right" if is_right else "not yet")
