"""Imports go one way: among the packages, their rooms and modules; the paper's files in the order of reading."""

import ast
import subprocess
import sys
from collections import defaultdict
from graphlib import TopologicalSorter
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
READ_IN_ORDER = (
    "signature",
    "residual",
    "misfit",
    "bounds",
    "cmaes",
    "stopping",
    "records",
    "table2",
    "table2_claims",
    "characteristic",
    "dead_zone",
    "standins",
    "sources",
)
# Rooms of the paper's package that its core and the sensor may import.
OPEN_ROOMS = {"replication", "replication/simulator"}
# What is not loaded yet when modules are imported one after the other.
KEPT_OUT = {
    "backlash.main": ("numpy", "studies", "workbook"),
    "replication.records": ("numba", "matplotlib", "studies", "workbook"),
    "backlash.commands": (
        *("cma", "joblib", "matplotlib", "pooch", "scipy.interpolate", "scipy.optimize"),
        *("scipy.signal", "scipy.stats", "studies", "tqdm", "workbook"),
    ),
}


def imported(file: Path) -> set[str]:
    """What a file imports of the project, at the top or in a function."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{name.name}" for name in node.names}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
    return {name for name in found if name.partition(".")[0] in MAY_IMPORT}


def module_of(file: Path) -> str:
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def room_of(name: str) -> str:
    """Folder of a module, such as "replication/figures"; a package's own files are a room too."""
    package, *rest = name.split(".")
    if name.startswith("backlash.refusals"):  # one file, for all rooms of the sensor
        return "backlash/refusals"
    return f"{package}/{rest[0]}" if rest and (ROOT / package / rest[0]).is_dir() else package


@pytest.fixture(scope="module")
def imports() -> dict[str, set[str]]:
    files = (file for package in MAY_IMPORT for file in (ROOT / package).rglob("*.py"))
    return {module_of(file): imported(file) for file in files}


@pytest.fixture(scope="module")
def rooms(imports) -> dict[str, set[str]]:
    """Rooms that each room imports; `__main__` only opens a door."""
    found = defaultdict(set)
    for module, names in imports.items():
        if not module.endswith("__main__"):
            found[room_of(module)] |= {room_of(name) for name in names} - {room_of(module)}
    return found


def test_a_package_imports_only_those_below_it(imports):
    for module, names in imports.items():
        package = module.partition(".")[0]
        assert {name.partition(".")[0] for name in names} - {package} <= MAY_IMPORT[package], module


def test_the_core_and_the_sensor_import_of_the_papers_package_only_the_core_and_the_simulator(
    rooms,
):
    for room, others in rooms.items():
        if room in OPEN_ROOMS or room.startswith("backlash"):
            assert {other for other in others if other.startswith("replication")} <= OPEN_ROOMS


def test_imports_among_rooms_and_among_modules_go_one_way(imports, rooms):
    graph = {room: others - {"replication"} for room, others in rooms.items()}
    del graph["replication"]
    TopologicalSorter(graph).prepare()
    graph = {}
    for module, names in imports.items():
        names = names | {name.rpartition(".")[0] for name in names}
        graph[module] = names & set(imports) - {module, *MAY_IMPORT}  # which only open doors
    TopologicalSorter(graph).prepare()


def test_a_file_of_the_paper_imports_only_those_before_it_and_the_simulated_joint_none(imports):
    later = {f"replication.{name}": {*READ_IN_ORDER[k:]} for k, name in enumerate(READ_IN_ORDER)}
    later |= {name: {*READ_IN_ORDER} - {"records"} for name in imports if ".simulator" in name}
    for module, names in later.items():
        found = {name.split(".")[1] for name in imports[module] if name.startswith("replication.")}
        assert not found & names, module


def test_a_module_loads_nothing_that_it_does_not_use():
    code = "import sys\n" + "".join(f"import {name}; print(*sys.modules)\n" for name in KEPT_OUT)
    command = [sys.executable, "-c", code]
    loaded = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    for line, kept_out in zip(loaded.splitlines(), KEPT_OUT.values(), strict=True):
        assert not set(line.split()) & set(kept_out)
