"""Does a wrong sign turn the tests red? Changes one thing at a time in the equations and runs their tests.

    .venv/bin/python -m tests.mutants --seed 1 --count 100

Each mutant has one operator, comparison, index or constant changed, in a copy of the project. It is killed if the tests
of its module fail, else the others of its package. Survivors are listed; the exit status is 1 if more than a tenth
survive.

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
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
# What computes; figures.py draws, published.py reads tables.
EQUATIONS = (
    "replication/*.py",
    *(f"studies/{n}.py" for n in ("claims", "identification", "multiverse", "standins")),
    *(f"backlash/{n}.py" for n in ("torque/*", "turns")),
)
LEFT_OUT = ("figures.py", "published.py", "__init__.py")
LIMIT_S = 900  # a mutant that loops for ever is killed, too
NOT_COPIED = shutil.ignore_patterns(".git", ".venv", "__pycache__", ".*_cache", ".make")
CHANGED: dict[type, type] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.Lt: ast.Gt,
    ast.Gt: ast.Lt,
    ast.LtE: ast.Lt,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}


def computing_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield nodes, those of annotations, decorators, messages and f-strings left out."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params", "exc"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(child, ast.JoinedStr):
                yield from computing_nodes(child)


def changes(tree: ast.Module) -> Iterator[tuple[Any, str, Any]]:
    """Yield a node, the name of its field and another value of it, for every mutant."""
    for node in computing_nodes(tree):
        if isinstance(node, ast.BinOp) and type(node.op) in CHANGED:
            yield node, "op", CHANGED[type(node.op)]()
        elif isinstance(node, ast.Compare):
            for k, operator in enumerate(node.ops):
                if type(operator) in CHANGED:
                    other = CHANGED[type(operator)]()
                    yield node, "ops", [*node.ops[:k], other, *node.ops[k + 1 :]]
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            yield node, "op", ast.UAdd()
        elif isinstance(node, ast.Constant) and type(node.value) is int:
            yield node, "value", node.value + 1
        elif isinstance(node, ast.Constant) and type(node.value) is float and node.value:
            yield node, "value", 1.25 * node.value


def draw_mutants(seed: int, count: int) -> list[tuple[Path, str, str]]:
    """Draw mutants, each as likely as any other: a file, what is changed, and the changed source."""
    files = {path for pattern in EQUATIONS for path in ROOT.glob(pattern)}
    mutants = []
    for file in sorted(path for path in files if path.name not in LEFT_OUT):
        tree = ast.parse(file.read_bytes())
        for node, field, value in changes(tree):
            before, old = ast.unparse(node), getattr(node, field)
            setattr(node, field, value)
            name = file.relative_to(ROOT)
            what = f"{name}:{node.lineno}: {before} -> {ast.unparse(node)}"
            mutants.append((name, what, ast.unparse(tree)))
            setattr(node, field, old)
    return Random(seed).sample(mutants, min(count, len(mutants)))


def passes(copy: Path, tests: list[Path]) -> bool:
    """Whether tests pass in a copy of the project; False if they take longer than the limit."""
    options = ["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow"]
    settings = {"NUMBA_CACHE_DIR": str(copy / "compiled")}
    command = [sys.executable, "-m", "pytest", *options, *tests]
    try:
        ended = subprocess.run(
            command, cwd=copy, env=os.environ | settings, timeout=LIMIT_S, stdout=subprocess.DEVNULL
        )
    except subprocess.TimeoutExpired:
        return False
    return ended.returncode == 0


def is_killed(file: Path, source: str, clean: Path, copy: Path) -> bool:
    """Whether a test of a file's package fails with another source of it, in a copy of a clean project."""
    # With what numba has compiled there, which serves but for this file; it is known by the folder's name.
    shutil.copytree(clean, copy)
    (copy / file).write_text(source, "utf-8")
    # The tests of the file itself first, which most likely fail.
    tests = (copy / "tests" / file.parts[0]).glob("test_*.py")
    killed = not passes(copy, sorted(tests, key=lambda path: file.stem not in path.stem))
    shutil.rmtree(copy)
    return killed


def main() -> int:
    """Run the mutants and print a line for each; return 1 if more than a tenth survive."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=100)
    options = parser.parse_args()
    for variable in ("BACKLASH_DATA", "PAPER_TEXT", "HARDWARE_LOGS"):  # as a new user has it
        os.environ.pop(variable, None)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    mutants = draw_mutants(options.seed, options.count)
    survivors = 0
    with tempfile.TemporaryDirectory() as folder:
        copy, clean = Path(folder) / "project", Path(folder) / "clean"
        shutil.copytree(ROOT, copy, ignore=NOT_COPIED)
        tests = sorted({copy / "tests" / file.parts[0] for file, *_ in mutants})
        if not passes(copy, tests):
            sys.exit(f"{' or '.join(path.name for path in tests)}: tests fail without a mutant")
        copy.rename(clean)
        for file, what, source in mutants:
            killed = is_killed(file, source, clean, copy)
            survivors += not killed
            print("killed  " if killed else "SURVIVED", what, flush=True)
    print(f"{len(mutants) - survivors} of {len(mutants)} mutants killed")
    return int(10 * survivors > len(mutants))


if __name__ == "__main__":
    sys.exit(main())
