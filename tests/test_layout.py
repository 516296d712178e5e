"""How the project is laid out: four packages, imports that run one way, and code that can be held in mind."""

import ast
import io
import subprocess
import sys
import tokenize
from collections import defaultdict
from collections.abc import Iterable, Mapping
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
PACKAGES = tuple(MAY_IMPORT)
FILES = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
# Rooms of the paper's package that its core may import, and the only ones that the sensor may, besides the core.
CORE_MAY_IMPORT = {f"replication/{room}" for room in ("compiled", "simulator")}

# Budgets: names, operators and literals, which is what has to be understood; lines can be packed.
MOST_TOKENS = {
    "replication": 38_000,
    "workbook": 18_500,
    "backlash": 53_000,
    "studies": 21_000,
    "tests": 106_000,
}
LONG_LINE = 100
MOST_LONG_LINES = 0.04  # of each package's lines
MOST_PACKED_ASSIGNMENTS = 15  # of three or more targets
MANY_PARAMETERS = 8  # only compiled kernels need so many
COUNTED = (tokenize.NAME, tokenize.OP, tokenize.NUMBER, tokenize.STRING)


def text_of(file: Path) -> str:
    return file.read_text("utf-8")


def files_of(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def tokens(files: Iterable[Path]) -> int:
    """Names, operators, numbers and strings in Python files."""
    return sum(
        token.type in COUNTED
        for file in files
        for token in tokenize.generate_tokens(io.StringIO(text_of(file)).readline)
    )


def imported(file: Path) -> set[str]:
    """Modules of the project that a file imports, at the top or in a function."""
    found = set()
    for node in ast.walk(ast.parse(text_of(file))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in PACKAGES:
            found |= {f"{node.module}.{name.name}" for name in node.names}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names if name.name.partition(".")[0] in PACKAGES}
    return found


def room_of(parts: tuple[str, ...]) -> str:
    """Folder of a module, such as "replication/replay"; a package's own files are a room too."""
    return (
        "/".join(parts[:2]) if len(parts) > 1 and (ROOT.joinpath(*parts[:2])).is_dir() else parts[0]
    )


def module_of(file: Path) -> tuple[str, ...]:
    parts = file.relative_to(ROOT).with_suffix("").parts
    return parts[:-1] if parts[-1] == "__init__" else parts


@pytest.fixture(scope="module")
def rooms() -> dict[str, set[str]]:
    """Rooms that each room imports; `__main__` only opens a door."""
    found = defaultdict(set)
    for file in FILES:
        room = room_of(module_of(file))
        if file.name != "__main__.py":
            found[room] |= {room_of(tuple(name.split("."))) for name in imported(file)} - {room}
    return found


def circles(imports: Mapping[str, set[str]]) -> list[str]:
    """What is left of a graph of imports when everything is taken away that imports nothing that is left."""
    left = dict(imports)
    while free := [name for name, others in left.items() if not others & set(left)]:
        left = {name: others for name, others in left.items() if name not in free}
    return sorted(left)


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_those_below_it(package):
    found = {name.partition(".")[0] for file in files_of(package) for name in imported(file)} - {
        package
    }
    assert found <= MAY_IMPORT[package]


def test_the_sensor_imports_of_the_papers_package_only_the_core_and_the_simulator(rooms):
    of_the_paper = {
        other
        for room, others in rooms.items()
        if room.startswith("backlash")
        for other in others
        if other.startswith("replication")
    }
    assert of_the_paper <= CORE_MAY_IMPORT | {"replication"}


def test_the_core_and_what_it_imports_import_no_room_beyond_it(rooms):
    for room in ("replication", *sorted(CORE_MAY_IMPORT)):
        assert rooms[room] <= CORE_MAY_IMPORT | {"replication"}, room


def test_imports_among_the_rooms_run_one_way(rooms):
    assert (
        circles(
            {
                room: others - {"replication"}
                for room, others in rooms.items()
                if room != "replication"
            }
        )
        == []
    )


def test_no_module_imports_itself_by_way_of_others():
    names = {".".join(module_of(file)): file for file in FILES}
    imports = {}
    for name, file in names.items():
        found = imported(file)
        imports[name] = (found | {each.rpartition(".")[0] for each in found}) & set(names) - {name}
    assert circles(imports) == []


@pytest.mark.parametrize("package", MOST_TOKENS)
def test_a_package_stays_small_enough_to_hold(package):
    assert tokens(files_of(package)) <= MOST_TOKENS[package]


@pytest.mark.parametrize("package", PACKAGES)
def test_lines_are_short_enough_to_read(package):
    lines = [line for file in files_of(package) for line in text_of(file).splitlines()]
    assert sum(len(line) > LONG_LINE for line in lines) <= MOST_LONG_LINES * len(lines)


def test_no_code_is_kept_from_the_formatter():
    skipped = [
        file for file in FILES if "fmt: skip" in text_of(file) or "fmt: off" in text_of(file)
    ]
    assert skipped == []


def test_hardly_any_assignment_has_three_targets_or_more():
    packed = [
        f"{file.relative_to(ROOT)}:{node.lineno}"
        for file in FILES
        for node in ast.walk(ast.parse(text_of(file)))
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Tuple)
        and isinstance(node.value, ast.Tuple)
        and len(node.targets[0].elts) >= 3
    ]
    assert len(packed) <= MOST_PACKED_ASSIGNMENTS, packed


def test_only_compiled_kernels_take_many_parameters():
    wide = []
    for file in FILES:
        for node in ast.walk(ast.parse(text_of(file))):
            if not isinstance(node, ast.FunctionDef) or any(
                "njit" in ast.unparse(d) for d in node.decorator_list
            ):
                continue
            given = node.args
            if len(given.posonlyargs + given.args + given.kwonlyargs) >= MANY_PARAMETERS:
                wide.append(f"{file.relative_to(ROOT)}:{node.lineno} {node.name}")
    assert wide == []


@pytest.mark.parametrize(
    ("modules", "kept_out"),
    [
        ("recording", ("numba", "matplotlib", "backlash")),
        ("recording, signature, table2", ("backlash", "workbook", "studies")),
    ],
)
def test_importing_the_core_loads_no_room_beyond_it(modules, kept_out):
    code = f"import sys; from replication import {modules}; print(*sys.modules, sep='\\n')"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout
    assert not [name for name in loaded.splitlines() if name.startswith(kept_out)]
