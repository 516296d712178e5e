"""What a user's own machine brings: odd folders, settings, consoles and places that cannot be written."""

import ast
import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from backlash import example
from replication import compilation, joint, published, records
from replication.files import UserError
from tests.logs import command, noisy, write
from workbook import judging, report, stamps
from workbook.__main__ import main as workbook_command

ROOT = Path(__file__).resolve().parents[1]


def test_the_shell_never_sees_where_the_checkout_lies(tmp_path):
    """A folder's name cannot be a command."""
    checkout = tmp_path / "x';touch PWNED;echo '$(touch PWNED)"
    checkout.mkdir()
    for name in ("Makefile", "pyproject.toml", "requirements.lock"):
        (checkout / name).write_bytes((ROOT / name).read_bytes())
    goals = (".venv/.installed", ".venv/.test", "test", "lab", "lint", "check")
    made = subprocess.run(
        ["make", "--dry-run", "--no-print-directory", *goals],
        cwd=checkout,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "venv" in made.stdout
    assert "PWNED" not in made.stdout
    assert not list(tmp_path.rglob("PWNED"))


def test_make_all_ends_where_it_cannot_ask_what_is_due(tmp_path):
    for name in ("pyproject.toml", "requirements.lock", ".venv/.installed"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    command = ["make", "--no-print-directory", "-f", ROOT / "Makefile", "all", "RUN=false"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True)
    assert ended.returncode == 2
    assert ended.stdout == b""


@pytest.mark.parametrize("words", [["workbook", "check"], ["backlash", "example"]], ids=str)
def test_a_command_whose_output_is_closed_says_so_in_one_line(words, tmp_path):
    line = 'cd "$0"; exec "$1" -m "$2" "$3" >&-'
    command = ["sh", "-c", line, tmp_path, sys.executable, *words]
    variables = os.environ | {"PYTHONPATH": str(ROOT)}
    ended = subprocess.run(command, env=variables, capture_output=True, text=True)
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert "standard output is closed" in ended.stderr


def test_a_console_that_takes_ascii_only_gets_every_line(monkeypatch):
    monkeypatch.delenv("BACKLASH_DATA", raising=False)
    console = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", console)
    for name in ("verdicts", "claims"):
        monkeypatch.setattr(judging, name, lambda results: None)
    monkeypatch.setattr(report, "list_verdicts", lambda *results: "34 µrad\nthe end")
    monkeypatch.setattr(report, "find_surprises", lambda verdicts: [])
    monkeypatch.setattr(stamps, "refuse_faults", lambda **which: None)
    assert workbook_command(["check"]) == 0
    assert console.buffer.getvalue().splitlines()[-1] == b"the end"


def test_a_package_that_is_gone_is_named_with_what_brings_it_back(monkeypatch, capsys):
    monkeypatch.delenv("BACKLASH_DATA", raising=False)
    monkeypatch.setitem(sys.modules, "workbook.project", None)
    assert workbook_command(["check"]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "remove .venv, and make" in line


def test_an_example_that_was_cut_is_named_and_nothing_is_written(tmp_path, monkeypatch):
    (tmp_path / "cut.csv").write_text("time [s],speed")
    monkeypatch.setattr(example, "LOG", tmp_path / "cut.csv")
    with pytest.raises(UserError, match=r"cut\.csv: damaged .* git checkout brings it back"):
        example.write_example(tmp_path / "new.csv")
    assert not (tmp_path / "new.csv").exists()


DAMAGES = {
    "missing": None,
    "cut": lambda text: text[: len(text) // 2],
    "a merge's mark": lambda text: text.replace(b"\n", b"\n<<<<<<< HEAD\n", 1),
    "not in UTF-8": lambda text: text + b"\xe9\n",
    "no lines": lambda text: b"\n",
}
READERS = {
    "cells.csv": lambda: published.cells(),
    "authors_sha256.txt": records.authors_checksums,
    "joint.json": joint.identified_joint,
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize("name", READERS)
def test_a_damaged_data_file_is_named_in_one_line(name, damage, tmp_path, monkeypatch):
    file = tmp_path / "data" / name
    file.parent.mkdir()
    text = (ROOT / "replication" / "data" / name).read_bytes()
    file.write_bytes(text)
    monkeypatch.setattr(published, "DATA", file.parent)
    monkeypatch.setattr(joint, "files", lambda package: tmp_path)
    monkeypatch.setattr(published, "read_data", published.read_data.__wrapped__)
    READERS[name]()
    file.write_bytes(damage(text)) if damage else file.unlink()
    with pytest.raises(UserError, match=rf"^{file}: .*git checkout brings it back$"):
        READERS[name]()


@pytest.mark.parametrize("value", ["~/nowhere", "README.md"])
def test_data_in_a_wrong_place_end_in_one_line_that_names_the_variable(value, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("BACKLASH_DATA", value)
    assert workbook_command(["data"]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "BACKLASH_DATA" in line


@pytest.mark.slow
def test_an_answer_and_its_plot_hang_on_none_of_a_users_settings(tmp_path):
    """Nor on a place that can be written, nor on a console with Unicode."""
    log = write(noisy(), tmp_path / "Ünïcode 'n' $HOME.csv")
    settings = tmp_path / "matplotlibrc"
    settings.write_text("text.usetex: True\nfont.family: serif\naxes.grid: True\n")
    hostile = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"), "/dev/null/x")
    hostile |= {"MPLBACKEND": "nonsense", "MATPLOTLIBRC": str(settings)}
    hostile |= {"PYTHONIOENCODING": "ascii", "LC_ALL": "C"}
    pictures = []
    for variables in ({}, hostile):
        picture = tmp_path / f"{len(pictures)}.svg"
        options = ["--turn-period", "0.4", "--plot", picture]
        ended = subprocess.run(
            [sys.executable, "-m", "backlash", "estimate", log, *options],
            cwd=ROOT,
            env=os.environ | variables,
            capture_output=True,
            check=True,
        )
        pictures.append(picture.read_bytes())
    assert ended.stdout.isascii()
    assert pictures[0] == pictures[1]


SETTINGS = {
    "no threads": ({"NUMBA_NUM_THREADS": "0"}, "", "must be > 0"),
    "no number": ({"NUMBA_NUM_THREADS": "two"}, "", "'two' could not be parsed"),
    "no YAML": ({}, "num_threads: [1\n - x: : {", "flow sequence"),
}
COMPILE = """
import sys
from replication.compilation import njit
from replication.files import UserError
try:
    njit(abs)
except UserError as error:
    sys.exit(str(error))
"""


def assert_numba_is_named(folder, setting, arguments):
    """Start Python under a setting of numba's, in a folder, and look for one line that names it."""
    variables, file, says = SETTINGS[setting]
    (folder / ".numba_config.yaml").write_text(file or "{}")
    ended = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ | variables | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert ended.returncode
    assert ended.stderr.count("\n") == 1
    assert says in ended.stderr
    assert "NUMBA_" in ended.stderr
    return ended


@pytest.mark.parametrize("setting", SETTINGS)
def test_a_setting_that_numba_does_not_start_with_is_named_in_one_line(tmp_path, setting):
    assert_numba_is_named(tmp_path, setting, ["-c", COMPILE])


def test_a_command_that_numba_does_not_start_for_ends_in_one_line(tmp_path):
    log = write(noisy(), tmp_path / "log.csv")
    words = ["-m", "backlash", "estimate", log, "--turn-period", "0.4"]
    assert assert_numba_is_named(tmp_path, "no number", words).returncode == 2


ASK = """
import os, sys
from types import SimpleNamespace
before = dict(os.environ)
from backlash.cli import main
assert os.environ == before, "an import sets nothing"
assert "numpy" not in sys.modules, "which reads them when it is imported"
tell = lambda options: print({name: os.environ.get(name) for name in NAMES})
sys.modules["backlash.cli.estimate_logs"] = SimpleNamespace(run=tell)  # what computes
main(["estimate", "log.csv"])
"""


@pytest.mark.parametrize("chosen", [{}, {"OPENBLAS_CORETYPE": "Prescott"}])
def test_the_command_computes_alike_on_every_processor_unless_a_kernel_is_chosen(chosen):
    pinned = compilation.pinned_environment()
    environment = {name: value for name, value in os.environ.items() if name not in pinned}
    asked = [sys.executable, "-c", ASK.replace("NAMES", repr([*pinned]))]
    ended = subprocess.run(
        asked, cwd=ROOT, env=environment | chosen, capture_output=True, text=True, check=True
    )
    expected = dict.fromkeys(pinned) | chosen if chosen else pinned
    assert ast.literal_eval(ended.stdout) == expected


def test_a_processor_without_avx2_gets_no_code_for_it(monkeypatch):
    monkeypatch.setattr(compilation, "has_avx2", lambda: False)
    assert compilation.pinned_environment()["NUMBA_CPU_NAME"] == "generic"


def test_an_empty_name_is_no_folder_of_logs(capsys):
    with pytest.raises(SystemExit, match="2"):
        command("estimate ''")
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "empty name" in line
