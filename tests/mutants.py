"""Does a wrong sign turn the tests red? Changes one thing at a time in the equations and runs their tests.

    .venv/bin/python -m tests.mutants --seed 1 --count 100

Each mutant has one operator, comparison, index or constant changed, in a copy of the project. It is killed if the tests
of its module fail, else those of its package. Survivors are listed; the exit status is 1 if more than a tenth survive.
"""

import argparse
import ast
import importlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path
from random import Random
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
# What computes; figures.py draws, published.py reads tables.
EQUATIONS = (
    "replication/*.py",
    "backlash/driven_load.py",
    "backlash/turns.py",
    "backlash/torque.py",
)
LEFT_OUT = ("replication/figures.py", "replication/published.py", "replication/__init__.py")
NOT_COPIED = shutil.ignore_patterns(
    ".git", ".venv", "__pycache__", ".*_cache", ".hypothesis", ".make"
)
OPERATORS = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.Pow: ("**", "*"),
    ast.Lt: ("<", ">"),
    ast.Gt: (">", "<"),
    ast.LtE: ("<=", "<"),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
}
# A mutant that loops for ever is killed, too.
TIMEOUT_S = 600


class Mutant(NamedTuple):
    """Where a file differs, and how."""

    file: str
    line: int
    start: int
    end: int
    before: str
    after: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.before} -> {self.after}"


def list_mutants(file: str) -> Iterator[Mutant]:
    """Yield every mutant of a file, in the order of the source."""
    source = (ROOT / file).read_bytes()
    offsets = [0]
    for line in source.splitlines(keepends=True):
        offsets.append(offsets[-1] + len(line))

    def place(line: int, column: int) -> int:
        return offsets[line - 1] + column

    def between(left: ast.expr, right: ast.expr, operator: ast.AST) -> Mutant | None:
        if type(operator) not in OPERATORS:
            return None
        before, after = OPERATORS[type(operator)]
        start = place(left.end_lineno or 0, left.end_col_offset or 0)
        start = source.index(before.encode(), start, place(right.lineno, right.col_offset))
        return Mutant(file, left.end_lineno or 0, start, start + len(before), before, after)

    for node in computing_nodes(ast.parse(source)):
        if isinstance(node, ast.BinOp):
            if mutant := between(node.left, node.right, node.op):
                yield mutant
        elif isinstance(node, ast.Compare):
            terms = [node.left, *node.comparators]
            for left, right, operator in zip(terms, terms[1:], node.ops, strict=False):
                if mutant := between(left, right, operator):
                    yield mutant
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            start = place(node.lineno, node.col_offset)
            yield Mutant(file, node.lineno, start, start + 1, "-", "+")
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            start = place(node.lineno, node.col_offset)
            end = place(node.end_lineno or 0, node.end_col_offset or 0)
            value = node.value
            after = repr(value + 1 if isinstance(value, int) else 1.25 * value)
            if after != repr(node.value):  # 0.0
                yield Mutant(file, node.lineno, start, end, source[start:end].decode(), after)


def computing_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield nodes, those of annotations, decorators, messages and f-strings left out."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params", "exc"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(child, ast.JoinedStr):
                yield from computing_nodes(child)


def drawn_mutants(seed: int, count: int, patterns: tuple[str, ...]) -> list[Mutant]:
    """Draw mutants from all files that compute; each is as likely as any other."""
    files = sorted(path.relative_to(ROOT).as_posix() for p in patterns for path in ROOT.glob(p))
    mutants = [mutant for file in files if file not in LEFT_OUT for mutant in list_mutants(file)]
    return Random(seed).sample(mutants, min(count, len(mutants)))


def test_targets(file: str) -> list[list[str]]:
    """Tests to run one after the other until one fails: those of the module, then those of its package."""
    package = Path(file).parts[0]
    paths = (ROOT / "tests" / package).rglob("test_*.py")
    own = [str(path.relative_to(ROOT)) for path in paths if path.stem == f"test_{Path(file).stem}"]
    return [own, [f"tests/{package}"]] if own else [[f"tests/{package}"]]


def run_tests(copy: Path, tests: list[str]) -> None:
    """Run tests in this process, and end it with pytest's status."""
    import numba

    # A file's compiled functions are kept, and made again when it has changed; no function is another file's.
    numba.config.CACHE_DIR = str(copy / ".numba")
    for variable in ("BACKLASH_DATA", "PAPER_TEXT", "HARDWARE_LOGS"):
        os.environ.pop(variable, None)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    os.chdir(copy)
    sys.path.insert(0, str(copy))
    sys.modules.pop("tests", None)
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    sys.dont_write_bytecode = True
    os._exit(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow", *tests]))


def passes(copy: Path, tests: list[str]) -> bool:
    """Whether tests pass in a copy of the project, as a new user has it; False if they take for ever."""
    process = get_context("fork").Process(target=run_tests, args=(copy, tests))
    process.start()
    process.join(TIMEOUT_S)
    process.kill()
    process.join()
    return process.exitcode in (0, pytest.ExitCode.NO_TESTS_COLLECTED)


def is_killed(mutant: Mutant, copy: Path) -> bool:
    """Whether a test fails in a copy of the project with this mutant."""
    path = copy / mutant.file
    source = path.read_bytes()
    path.write_bytes(source[: mutant.start] + mutant.after.encode() + source[mutant.end :])
    try:
        return not all(passes(copy, tests) for tests in test_targets(mutant.file))
    finally:
        path.write_bytes(source)


def main() -> int:
    """Run the mutants and print a line for each; return 1 if more than a tenth survive."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--files", nargs="*", default=EQUATIONS, help="patterns of files to change")
    options = parser.parse_args()
    # What tests load is loaded once: each run is a fork of this process.
    for library in (
        "cma",
        "hypothesis",
        "numba",
        "pandas",
        "scipy.optimize",
        "scipy.signal",
        "scipy.stats",
    ):
        importlib.import_module(library)
    mutants = drawn_mutants(options.seed, options.count, tuple(options.files))
    survivors = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "project"
        shutil.copytree(ROOT, copy, ignore=NOT_COPIED)
        for package in sorted({Path(mutant.file).parts[0] for mutant in mutants}):
            if not passes(copy, [f"tests/{package}"]):
                sys.exit(f"tests/{package} fails without a mutant")
        for mutant in mutants:
            killed = is_killed(mutant, copy)
            survivors += [] if killed else [mutant]
            print("killed  " if killed else "SURVIVED", mutant, flush=True)
    print(f"{len(mutants) - len(survivors)} of {len(mutants)} mutants killed")
    return int(10 * len(survivors) > len(mutants))


if __name__ == "__main__":
    sys.exit(main())
