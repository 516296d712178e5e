"""Names between backticks in docstrings and comments are names that the project or its libraries have."""

import ast
import importlib.util
import io
import re
import sys
import tokenize
from functools import cache
from pathlib import Path

import pytest

from replication import published
from workbook import ROOT

FOLDERS = ("replication", "backlash", "workbook", "studies", "notebooks", "tests")
SOURCES = sorted(
    {path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")} - {Path(__file__)}
)
ELSEWHERE = ("dsyev",)  # a name of LAPACK
QUOTED = re.compile(r"(?<!`)`([A-Za-z_][\w.]*)`(?!`)")
FILE = re.compile(r".*\.(csv|json|md|py|ipynb|html|typ|toml|txt|lock|svg|png|xlsx|zip|done|d)")


@cache
def words_of_code(path: Path) -> frozenset[str]:
    """Identifiers and words in the strings of a file's code, its docstrings and comments left out."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    found = set()
    for node in ast.walk(tree):
        names = [getattr(node, name, None) for name in ("id", "attr", "arg", "name")]
        found |= {name for name in names if isinstance(name, str)}
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in prose:
            found |= set(re.findall(r"\w+", node.value))
    return frozenset(found)


@cache
def variables(path: Path) -> frozenset[str]:
    """Names that a file gives to values: of parameters, assignments and loops."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    stored = {
        node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
    return frozenset(stored | {node.arg for node in nodes if isinstance(node, ast.arg)})


@cache
def words() -> frozenset[str]:
    """Every name that the project has: in code, as a file, as a table's column."""
    found = set().union(*(words_of_code(path) for path in SOURCES))
    for path in [
        *SOURCES,
        *(ROOT / "results").rglob("*.*"),
        *(ROOT / "replication" / "data").iterdir(),
    ]:
        found |= {*path.parts, path.stem}
        if path.suffix == ".csv":
            lines = path.read_text(encoding="utf-8").splitlines()
            found |= set(
                re.findall(r"\w+", " ".join(lines if path.parent.name == "data" else lines[:1]))
            )
    return frozenset(
        found | set(re.findall(r"\w+", (ROOT / "Makefile").read_text(encoding="utf-8")))
    )


@cache
def beginnings() -> tuple[str, ...]:
    """What names begin with that an f-string makes."""
    return tuple(word for word in words() if len(word) > 6 and word.endswith("_"))


@cache
def modules() -> dict[str, Path]:
    """Files of the packages by dotted name, such as "replication.simulator.core"."""
    found = {}
    for path in SOURCES:
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def is_library(name: str) -> bool:
    return name in sys.builtin_module_names or importlib.util.find_spec(name) is not None


def exists(name: str, path: Path) -> bool:
    """Whether a quoted name means something where it stands."""
    if name.endswith("..."):
        return any(word.startswith(name.rstrip(".")) for word in words())
    if name.startswith(beginnings()) or name in published.cells().index:
        return True
    first, *rest = name.strip(".").split(".")
    if not rest:
        return first in words() or first in ELSEWHERE or is_library(first)
    if FILE.fullmatch(name):
        return (
            name in words() or name.rpartition(".")[0].rstrip("KR") in words()
        )  # a level, a realisation
    here = [
        module
        for module in modules()
        if f".{module}".endswith(f".{first}") or f".{first}." in f".{module}."
    ]
    for module in here:
        owner = modules()[module]
        if rest[-1] in words_of_code(owner) or f"{module}.{rest[-1]}" in modules():
            return True
    # An attribute of a variable or of a class, or a library's name.
    known = first in variables(path) or (first in words() and first[0].isupper())
    return (not here and is_library(first)) or (known and rest[-1] in words())


def prose(path: Path) -> list[tuple[int, str]]:
    """Docstrings and comments with their lines."""
    text = path.read_text(encoding="utf-8")
    found = [
        (token.start[0], token.string)
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type == tokenize.COMMENT
    ]
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    owners = [node for node in ast.walk(ast.parse(text)) if isinstance(node, kinds)]
    return found + [(getattr(node, "lineno", 1), ast.get_docstring(node) or "") for node in owners]


def dead_names() -> list[str]:
    return [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for path in SOURCES
        for line, text in prose(path)
        for name in QUOTED.findall(text)
        if not exists(name, path)
    ]


def test_every_name_that_a_docstring_or_a_comment_quotes_exists():
    assert dead_names() == []


@pytest.mark.parametrize(
    "name", ["experiments.repeated_fits", "log_tables", "table2.gone", "no_such_file.csv"]
)
def test_a_name_that_is_gone_is_noticed(name):
    assert not exists(name, ROOT / "replication" / "table2.py")


@pytest.mark.parametrize(
    "name", ["table2.summarise_runs", "scipy.optimize.least_squares", "cells.csv", "delta_rad"]
)
def test_a_name_that_is_there_passes(name):
    assert exists(name, ROOT / "replication" / "table2.py")
