"""Imports go one way: among the packages, among the rooms of a package, and among modules."""

import ast
import subprocess
import sys
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import pytest

from replication.files import ROOT

# What each package may import of the others.
MAY_IMPORT = {
    "replication": set(),
    "backlash": {"replication"},
    "workbook": {"replication"},
    "studies": {"replication", "backlash"},
}
FILES = [path for package in MAY_IMPORT for path in sorted((ROOT / package).rglob("*.py"))]
# Rooms of the paper's package that its core and the sensor may import.
OPEN_ROOMS = {"replication", "replication/simulator"}


def imported(file: Path) -> set[str]:
    """Modules of the project that a file imports, at the top or in a function."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{name.name}" for name in node.names}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
    return {name for name in found if name.partition(".")[0] in MAY_IMPORT}


def module_of(file: Path) -> str:
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_of(name: str) -> str:
    """Folder of a module, such as "replication/figures"; a package's own files are a room too."""
    package, *rest = name.split(".")
    return f"{package}/{rest[0]}" if rest and (ROOT / package / rest[0]).is_dir() else package


def circles(imports: Mapping[str, set[str]]) -> list[str]:
    """What is left of a graph of imports when everything is taken away that imports nothing that is left."""
    left = dict(imports)
    while free := [name for name, others in left.items() if not others & set(left)]:
        left = {name: others for name, others in left.items() if name not in free}
    return sorted(left)


@pytest.fixture(scope="module")
def rooms() -> dict[str, set[str]]:
    """Rooms that each room imports; `__main__` only opens a door."""
    found = defaultdict(set)
    for file in FILES:
        if file.name != "__main__.py":
            room = room_of(module_of(file))
            found[room] |= {room_of(name) for name in imported(file)} - {room}
    return found


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_a_package_imports_only_those_below_it(package):
    files = (file for file in FILES if file.is_relative_to(ROOT / package))
    found = {name.partition(".")[0] for file in files for name in imported(file)}
    assert found - {package} <= MAY_IMPORT[package]


def test_the_core_and_the_sensor_import_of_the_papers_package_only_the_core_and_the_simulator(
    rooms,
):
    for room, others in rooms.items():
        if room in OPEN_ROOMS or room.startswith("backlash"):
            assert {other for other in others if other.startswith("replication")} <= OPEN_ROOMS


def test_imports_among_the_rooms_go_one_way(rooms):
    graph = {room: others - {"replication"} for room, others in rooms.items()}
    del graph["replication"]
    assert circles(graph) == []


def test_no_module_imports_itself_by_way_of_others():
    imports = {module_of(file): imported(file) for file in FILES}
    for name, found in imports.items():
        found |= {each.rpartition(".")[0] for each in found}
        imports[name] = found & set(imports) - {name}
    assert circles(imports) == []


def test_importing_the_core_loads_no_room_beyond_it():
    code = "import sys; from replication import records; print(*sys.modules, sep='\\n')"
    command = [sys.executable, "-c", code]
    loaded = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    beyond = ("numba", "matplotlib", "backlash", "workbook", "studies")
    assert not [name for name in loaded.splitlines() if name.startswith(beyond)]
