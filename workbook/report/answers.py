"""What the report draws of Table 2, where code stands, and how long a notebook runs."""

import ast
import math
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from replication.files import ROOT
from workbook.report.cells import Cell


def table2_dumbbells(results: Path, cells: dict[str, Cell]) -> list[dict]:
    """Region, theoretical A and the mean of each realisation, in percent of each of Table 2's ten printed means."""
    if not (results / "table2.csv").exists():
        return []
    table = pd.read_csv(results / "table2.csv").query("source == 'authors' and row <= 10")
    rows = []
    for row, part in table.groupby("row"):
        mean, theoretical = (cells[f"table2.row{row:02d}.{name}"] for name in ("mean", "theoretical"))
        judged = mean.deciding
        numbers = np.array([judged.low, judged.high, theoretical.value, *part["mean_A_rps"]])
        low, high, theory, *means = (100 * (numbers / mean.value - 1)).tolist()
        about = {"row": int(row), "low": low, "high": high, "theoretical": theory}
        rows.append(about | {"means": means, "verdict": judged.verdict})
    return rows


def runs_of_cells(results: Path) -> dict[str, list[tuple[int, list[float]]]]:
    """|A| [rps] of the runs behind each mean and SD of Table 2 that the authors' data judge, by realisation."""
    if not (results / "table2_runs.csv").exists():
        return {}
    runs = pd.read_csv(results / "table2_runs.csv").query("source == 'authors' and row <= 10")
    found: dict[str, list[tuple[int, list[float]]]] = {}
    for row, part in runs.groupby("row"):
        strips = [(int(number), each["A_rps"].abs().tolist()) for number, each in part.groupby("realisation")]
        found |= {f"table2.row{row:02d}.{kind}": strips for kind in ("mean", "sd")}
    return found


def verdicts_by_other_seeds(results: Path) -> dict[str, str]:
    """The verdict that other seeds give, of each of Table 2's cells where it is another, by id."""
    if not (file := results / "table2_other_seeds.csv").exists():
        return {}
    changed = pd.read_csv(file).query("verdict != verdict_other_seeds")
    return dict(zip(changed["id"], changed["verdict_other_seeds"], strict=True))


def disagreement(cell: Cell) -> float:
    """How far a printed number is from ours, in halves of its region's width; nan where nothing judges it."""
    judged = cell.deciding
    half = (judged.high - judged.low) / 2
    return abs(judged.reproduced - cell.value) / half if math.isfinite(half) and half > 0 else math.nan


@cache
def code_line(name: str) -> str:
    """Address of a function of the package, or of a test "file::name", with the line at which it begins."""
    file, _, function = name.partition("::")
    if not function:
        module, _, function = name.rpartition(".")
        file = f"replication/{module.replace('.', '/')}.py"
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    defined = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef))
    return next(f"{file}#L{node.lineno}" for node in defined if node.name == function)


def run_times(results: Path) -> dict[str, str]:
    """How long each notebook ran when that was measured, by its name."""
    if not (file := results / "notebook_times.csv").exists():
        return {}
    rows = pd.read_csv(file).itertuples()
    return {row.notebook: f"{row.seconds:.0f} s on {row.cores} cores, {row.machine}" for row in rows}
