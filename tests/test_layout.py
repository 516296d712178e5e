"""How the package is laid out: a thin core that shows the paper, and rooms whose imports run one way."""

import ast
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

from replication.workbook import ROOT

PACKAGE = ROOT / "replication"
ROOMS = sorted(folder.name for folder in PACKAGE.iterdir() if (folder / "__init__.py").exists())
CORE_MAY_IMPORT = {"compiled", "simulator", "data", "figures", "workbook"}
MOST_LINES = 1500


def room_of(parts: tuple[str, ...]) -> str:
    return parts[0] if parts and parts[0] in ROOMS else "core"


def imported(file: Path) -> set[str]:
    """Modules of the package that a file imports, at the top or in a function."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "replication":
            found |= {f"{node.module}.{name.name}" for name in node.names}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names if name.name.partition(".")[0] == "replication"}
    return found


@pytest.fixture(scope="module")
def rooms() -> dict[str, set[str]]:
    """Rooms that each room imports; the core is one, `__main__` only opens the door."""
    found = defaultdict(set)
    for file in PACKAGE.rglob("*.py"):
        room = room_of(file.relative_to(PACKAGE).parts)
        if file.name != "__main__.py":
            found[room] |= {room_of(tuple(name.split(".")[1:])) for name in imported(file)} - {room}
    return found


def test_the_core_imports_no_room_but_those_that_it_is_made_with(rooms):
    assert rooms["core"] <= CORE_MAY_IMPORT


def test_imports_among_the_rooms_beyond_the_core_run_one_way(rooms):
    left = {room: set(others) - {"core"} for room, others in rooms.items() if room != "core"}
    while left:
        free = {room for room, others in left.items() if not others & set(left)}
        assert free, f"a circle among {sorted(left)}"
        left = {room: others for room, others in left.items() if room not in free}


def test_what_the_core_imports_imports_no_room_beyond_it(rooms):
    for room in CORE_MAY_IMPORT:
        assert rooms[room] <= CORE_MAY_IMPORT | {"core"}, room


def test_the_core_can_be_read_in_one_sitting():
    assert sum(len(file.read_text(encoding="utf-8").splitlines()) for file in PACKAGE.glob("*.py")) <= MOST_LINES


@pytest.mark.parametrize(
    ("modules", "kept_out"),
    [
        ("datasets", ("numba", "matplotlib", "replication.global_fit", "replication.sensor")),
        ("datasets, signature, table2", ("replication.global_fit", "replication.sensor", "replication.studies")),
    ],
)
def test_importing_the_core_loads_no_room_beyond_it(modules, kept_out):
    code = f"import sys; from replication import {modules}; print(*sys.modules, sep='\\n')"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert not [name for name in loaded.splitlines() if name.startswith(kept_out)]


def test_no_module_imports_itself_by_way_of_others():
    names = {".".join(file.relative_to(ROOT).with_suffix("").parts): file for file in PACKAGE.rglob("*.py")}
    left = {}
    for name, file in names.items():
        found = imported(file)
        left[name] = (found | {each.rpartition(".")[0] for each in found}) & set(names) - {name}
    while left:
        free = {name for name, others in left.items() if not others & set(left)}
        assert free, f"a circle among {sorted(left)}"
        left = {name: others for name, others in left.items() if name not in free}
