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
QUOTED = re.compile(r"(?<!`)`([A-Za-z_][\w.]*)`(?!`)")
FILE = re.compile(r".*\.(csv|json|md|py|ipynb|html|typ|toml|txt|lock|svg|png|xlsx|zip|done|d)")


def words_of_code(path: Path) -> set[str]:
    """Identifiers and words in the strings of a file's code, its docstrings and comments left out."""
    tree = ast.parse(path.read_text("utf-8"))
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    found = set()
    for node in ast.walk(tree):
        names = [getattr(node, name, None) for name in ("id", "attr", "arg", "name")]
        found |= {name for name in names if isinstance(name, str)}
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in prose:
            found |= set(re.findall(r"\w+", node.value))
    return found


@cache
def words() -> frozenset[str]:
    """Every name that the project has: in code, as a file or folder, as a table's column, as a cell."""
    found = {*published.cells().index, "dsyev"}  # the latter is a name of LAPACK
    for path in SOURCES:
        found |= words_of_code(path) | {*path.parts, path.stem}
    for path in [*(ROOT / "results").rglob("*.*"), *(ROOT / "replication" / "data").iterdir()]:
        found |= {*path.parts, path.stem}
        if path.suffix == ".csv":
            lines = path.read_text("utf-8").splitlines()
            shown = lines if path.parent.name == "data" else lines[:1]
            found |= set(re.findall(r"\w+", " ".join(shown)))
    return frozenset(found | set(re.findall(r"\w+", (ROOT / "Makefile").read_text("utf-8"))))


@cache
def exists(name: str) -> bool:
    """Whether a quoted name means something: each part of it is a name here, or the first a library's."""
    if name.endswith("..."):
        return any(word.startswith(name.rstrip(".")) for word in words())
    if name in words() or FILE.fullmatch(name):
        return name in words() or name.rpartition(".")[0].rstrip("KR") in words()
    first, *rest = name.strip(".").split(".")
    if {first, *rest} <= words():
        return True
    # What an f-string makes begins so; a library.
    made = any(len(word) > 6 and word.endswith("_") and first.startswith(word) for word in words())
    return made or first in sys.builtin_module_names or importlib.util.find_spec(first) is not None


def prose(path: Path) -> list[tuple[int, str]]:
    """Docstrings and comments with their lines."""
    text = path.read_text("utf-8")
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
        if not exists(name)
    ]


def test_every_name_that_a_docstring_or_a_comment_quotes_exists():
    assert dead_names() == []


@pytest.mark.parametrize("name", ["table2.unheard_of", "no_such.csv"])
def test_a_name_that_is_gone_is_noticed(name):
    assert not exists(name)


@pytest.mark.parametrize("name", ["table2.summarise_runs", "cells.csv"])
def test_a_name_that_is_there_passes(name):
    assert exists(name)
