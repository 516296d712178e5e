"""The notebooks' sources, and the files that each makes.

By the standard library alone: a run of a notebook needs no more of the workbook.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

from replication.files import ROOT, UserError

NOTEBOOKS, RESULTS = ROOT / "notebooks", ROOT / "results"


def notebook_sources() -> dict[str, Path]:
    """Sources of the paper's notebooks and of those beyond it by name, in the order of their numbers."""
    files = [*NOTEBOOKS.glob("[0-9]*.py"), *NOTEBOOKS.glob("beyond/[0-9]*.py")]
    return {path.stem: path for path in sorted(files, key=lambda path: path.name)}


def listed_exports(source: Path) -> list[str]:
    """Files that a notebook makes, from the project's folder, as the calls in its source name them.

    Its `.ipynb`; both files of each figure that it shows; what its call of `verdict` exports: an outcome and tables.
    """
    folder = "notebooks" if source.parent.name == "notebooks" else "notebooks/beyond"
    return [f"{folder}/{source.stem}.ipynb", *_named_files(source)]


def _named_files(source: Path) -> Iterator[str]:
    parameters = ("text", "cells", "claims", "facts", "tables")  # of `verdict`, in their order
    try:
        tree = ast.parse(source.read_bytes())
    except (SyntaxError, ValueError) as error:
        raise UserError(f"{source}: not Python in UTF-8: {error}") from error
    for call in ast.walk(tree):
        match call:
            case ast.Call(ast.Attribute(attr="show_figure"), [ast.Constant(str(name)), *_]):
                yield from (f"figures/{name}.{kind}" for kind in ("png", "svg"))
            case ast.Call(ast.Attribute(attr="verdict"), values, keywords):
                given = dict(zip(parameters, values, strict=False))
                given |= {each.arg: each.value for each in keywords if each.arg}
                if {"cells", "claims", "facts"} & {*given}:
                    yield f"results/outcomes/{source.stem}.json"
                if isinstance(tables := given.get("tables"), ast.Dict):
                    for key in tables.keys:
                        if isinstance(key, ast.Constant):
                            yield f"results/{key.value!s}.csv"


def refuse_missing() -> None:
    """Refuse to go on where a file is missing that a notebook makes, or an outcome is there that none makes.

    What is missing is never judged; nor what a notebook had made before it, or its end, was removed.
    """
    listed: set[str] = set()
    for source in notebook_sources().values():
        for name in listed_exports(source):
            listed.add(name)
            file = ROOT / name
            if not file.is_file() or not file.stat().st_size:
                raise UserError(f"{name} is missing or empty; {how_to_make(source)}")
    there = {f"results/outcomes/{file.name}" for file in RESULTS.glob("outcomes/*.json")}
    for name in sorted(there - listed):
        raise UserError(
            f"{name}: no notebook makes it; git checkout brings the notebook back, or delete it"
        )


def how_to_make(source: Path) -> str:
    """Say which command makes again what a notebook makes."""
    return f".venv/bin/python -m workbook run {source.relative_to(ROOT)} makes it"
