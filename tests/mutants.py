"""Does a wrong sign turn the tests red? Changes one thing at a time in the equations and runs their tests.

    .venv/bin/python -m tests.mutants --seed 1 --count 100

Each mutant has one operator, comparison, index or constant changed, in a copy of the project. It is killed if the tests
of its module fail, else those that import it, else the others of its package. Survivors are listed; the exit status is
1 if more than a tenth survive.

Survivors of these kinds are no holes, because they change nothing that is computed, or only how fast:

- a comparison at a value that is not taken, or where both sides give the same: `way < 1` for -1 and 1, `>=` at a kink;
- a guard against rounding where values are exact or far off: `+ 1e-9` before int(), the residual of a regula falsi;
- how an end is reached and not which: the weights of the regula falsi, rough starting values, starts and finalists of a
  search beyond those that it needs;
- the sign, the seed and the number of draws of a symmetric noise or a bootstrap, and an index beside 0: `2 + 0`;
- sizes that have converged or suffice: steps of a grid, the most crossings in a step, a download's timeout.
"""

import argparse
import ast
import importlib
import json
import os
import re
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
# In the copy: how long each test takes, and what numba has compiled.
TIMES, COMPILED = "times.json", "compiled"


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


def seconds_by_file(copy: Path) -> dict[str, float]:
    """How long each file's tests took without a mutant."""
    seconds: dict[str, float] = {}
    for test, duration in json.loads((copy / TIMES).read_text()).items():
        path = test.partition("::")[0]
        seconds[path] = seconds.get(path, 0.0) + duration
    return seconds


def test_stages(file: str, copy: Path) -> list[list[str]]:
    """Files of a package's tests in three stages: named after it, that import it, the rest; fastest first."""
    package, name = Path(file).parts[0], Path(file).stem
    seconds = seconds_by_file(copy)
    stages: list[list[str]] = [[], [], []]
    for path in sorted(seconds, key=seconds.__getitem__):
        if path.startswith(f"tests/{package}/"):
            imports = re.search(rf"^(from|import) .*\b{name}\b", (copy / path).read_text(), re.M)
            is_own = Path(path).stem.startswith(f"test_{name}")
            stages[0 if is_own else 1 if imports else 2].append(path)
    return [stage for stage in stages if stage]


class FastestFirst:
    """Pytest's plugin: the fastest tests of each file come first, and their times are kept."""

    def __init__(self, times: Path) -> None:
        self.known = json.loads(times.read_text()) if times.exists() else {}
        self.seconds: dict[str, float] = {}

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        files = {item.path: place for place, item in reversed(list(enumerate(items)))}
        items.sort(key=lambda item: (files[item.path], self.known.get(item.nodeid, 0.0)))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration


def run_tests(copy: Path, tests: list[str], cache: str, has_mutant: bool) -> None:
    """Run tests in this process, and end it with pytest's status."""
    import numba

    numba.config.CACHE_DIR = str(copy / cache)
    for variable in ("BACKLASH_DATA", "PAPER_TEXT", "HARDWARE_LOGS"):
        os.environ.pop(variable, None)
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "LOKY_MAX_CPU_COUNT": "1"}
    os.chdir(copy)
    sys.path.insert(0, str(copy))
    sys.modules.pop("tests", None)
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    sys.dont_write_bytecode = has_mutant
    first = FastestFirst(copy / TIMES)
    options = ["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow"]
    status = pytest.main([*options, *tests], [first])
    if not has_mutant:
        (copy / TIMES).write_text(json.dumps(first.seconds))
    os._exit(status)


def passes(
    copy: Path, tests: list[str], cache: str, has_mutant: bool = True, limit_s: float | None = None
) -> bool:
    """Whether tests pass in a copy of the project, as a new user has it; False if they take longer than a limit."""
    process = get_context("fork").Process(target=run_tests, args=(copy, tests, cache, has_mutant))
    process.start()
    process.join(limit_s)
    process.kill()
    process.join()
    return process.exitcode in (0, pytest.ExitCode.NO_TESTS_COLLECTED)


def is_killed(mutant: Mutant, copy: Path) -> bool:
    """Whether a test fails in a copy of the project with this mutant."""
    path = copy / mutant.file
    source, status = path.read_bytes(), path.stat()
    path.write_bytes(source[: mutant.start] + mutant.after.encode() + source[mutant.end :])
    # What numba has compiled of other files serves; what it compiles of this one goes.
    shutil.copytree(copy / COMPILED, copy / "mutants")
    try:
        seconds = seconds_by_file(copy)
        for tests in test_stages(mutant.file, copy):
            # A mutant that loops for ever is killed, too; what it lets compile again takes some time.
            limit_s = 60 + 5 * sum(seconds[path] for path in tests)
            if not passes(copy, tests, "mutants", limit_s=limit_s):
                return True
        return False
    finally:
        shutil.rmtree(copy / "mutants")
        path.write_bytes(source)
        os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


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
        tests = sorted({f"tests/{Path(mutant.file).parts[0]}" for mutant in mutants})
        if not passes(copy, tests, COMPILED, has_mutant=False):
            sys.exit(f"{' or '.join(tests)} fails without a mutant")
        for mutant in mutants:
            killed = is_killed(mutant, copy)
            survivors += [] if killed else [mutant]
            print("killed  " if killed else "SURVIVED", mutant, flush=True)
    print(f"{len(mutants) - len(survivors)} of {len(mutants)} mutants killed")
    return int(10 * len(survivors) > len(mutants))


if __name__ == "__main__":
    sys.exit(main())
