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
from workbook import report, stamps
from workbook.__main__ import main as workbook_command

ROOT = Path(__file__).resolve().parents[1]


def run(*words, **options):
    """Run a program; what it prints is text."""
    return subprocess.run(words, capture_output=True, text=True, **options)


def assert_one_line(printed, says):
    assert printed.count("\n") == 1
    assert says in printed


def test_the_shell_never_sees_where_the_checkout_lies(tmp_path):
    """A folder's name cannot be a command."""
    checkout = tmp_path / "x';touch PWNED;echo '$(touch PWNED)"
    checkout.mkdir()
    for name in ("Makefile", "pyproject.toml", "requirements.lock"):
        (checkout / name).write_bytes((ROOT / name).read_bytes())
    goals = (".venv/.installed", ".venv/.test", "test", "lab", "lint", "check")
    made = run("make", "--dry-run", "--no-print-directory", *goals, cwd=checkout, check=True)
    assert "venv" in made.stdout
    assert "PWNED" not in made.stdout
    assert not list(tmp_path.rglob("PWNED"))


def test_make_all_ends_where_it_cannot_ask_what_is_due(tmp_path):
    for name in ("pyproject.toml", "requirements.lock", ".venv/.installed"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    settings = ["--no-print-directory", "RUN=false"]
    ended = run("make", "-f", ROOT / "Makefile", "all", *settings, cwd=tmp_path)
    assert (ended.returncode, ended.stdout) == (2, "")


def test_a_command_whose_output_is_closed_says_so_in_one_line(tmp_path):
    line = 'exec "$0" -m backlash example >&-'
    variables = os.environ | {"PYTHONPATH": str(ROOT)}
    ended = run("sh", "-c", line, sys.executable, env=variables, cwd=tmp_path)
    assert ended.returncode == 2
    assert_one_line(ended.stderr, "standard output is closed")


def test_a_console_that_takes_ascii_only_gets_every_line(monkeypatch):
    monkeypatch.delenv("BACKLASH_DATA", raising=False)
    console = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", console)
    monkeypatch.setattr(report, "list_verdicts", lambda *results: "34 µrad\nthe end")
    monkeypatch.setattr(stamps, "refuse_faults", lambda: None)
    assert workbook_command(["check"]) == 0
    assert console.buffer.getvalue().splitlines()[-1] == b"the end"


def test_a_package_that_is_gone_is_named_with_what_brings_it_back(monkeypatch, capsys):
    monkeypatch.delenv("BACKLASH_DATA", raising=False)
    monkeypatch.setitem(sys.modules, "workbook.project", None)
    assert workbook_command(["check"]) == 2
    assert_one_line(capsys.readouterr().err, "remove .venv, and make")


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
    assert_one_line(capsys.readouterr().err, "BACKLASH_DATA")


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
        words = [sys.executable, "-m", "backlash", "estimate", log, *options]
        ended = run(*words, cwd=ROOT, env=os.environ | variables, check=True)
        pictures.append(picture.read_bytes())
    assert ended.stdout.isascii()
    assert pictures[0] == pictures[1]


@pytest.mark.parametrize(
    ("variables", "file", "says"),
    [
        ({"NUMBA_NUM_THREADS": "0"}, "{}", "must be > 0"),
        ({"NUMBA_NUM_THREADS": "two"}, "{}", "'two' could not be parsed"),
        ({}, "num_threads: [1\n - x: : {", "flow sequence"),
    ],
    ids=["no threads", "no number", "no YAML"],
)
def test_a_setting_that_numba_does_not_start_with_is_named_in_one_line(
    tmp_path, variables, file, says
):
    (tmp_path / ".numba_config.yaml").write_text(file)
    write(noisy(), tmp_path / "log.csv")
    words = [sys.executable, "-m", "backlash", "estimate", "log.csv", "--turn-period", "0.4"]
    environment = os.environ | variables | {"PYTHONPATH": str(ROOT)}
    ended = run(*words, cwd=tmp_path, env=environment)
    assert ended.returncode == 2
    assert_one_line(ended.stderr, says)
    assert "NUMBA_" in ended.stderr


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
    asked = ASK.replace("NAMES", repr([*pinned]))
    ended = run(sys.executable, "-c", asked, cwd=ROOT, env=environment | chosen, check=True)
    expected = dict.fromkeys(pinned) | chosen if chosen else pinned
    assert ast.literal_eval(ended.stdout) == expected


def test_a_processor_without_avx2_gets_no_code_for_it(monkeypatch):
    monkeypatch.setattr(compilation, "has_avx2", lambda: False)
    assert compilation.pinned_environment()["NUMBA_CPU_NAME"] == "generic"


def test_an_empty_name_is_no_folder_of_logs(capsys):
    with pytest.raises(SystemExit, match="2"):
        command("estimate ''")
    assert_one_line(capsys.readouterr().err, "empty name")
