"""What is released says one version, and works in an empty environment."""

import json
import re
import subprocess
import sys
import venv

import pytest

import backlash
from replication.files import ROOT
from tests.logs import command

LARGEST_WHEEL = 300_000  # bytes


def test_the_files_of_a_release_say_the_version_of_the_package_and_name_files_that_are_there():
    version = backlash.__version__
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text("utf-8")
    assert json.loads((ROOT / ".zenodo.json").read_text("utf-8"))["version"] == version
    assert f"## {version}\n" in (ROOT / "CHANGELOG.md").read_text("utf-8")
    for name in re.findall(r"- file: (.*)", (ROOT / "codecheck.yml").read_text("utf-8")):
        assert (ROOT / name).is_file(), name


def test_the_example_is_written_once_and_the_command_that_it_prints_answers_it(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert command("example") == 0
    asked = capsys.readouterr().out.splitlines()[-1]
    assert command(asked.removeprefix("backlash "), "--json") == 0
    (answer,) = json.loads(capsys.readouterr().out)
    low, high = answer["backlash_interval_rad"]
    assert low < 8e-4 < high
    assert command("example") == 2
    assert "example.csv" in capsys.readouterr().err


@pytest.mark.slow
def test_the_wheel_is_small_and_installed_into_an_empty_environment_answers_its_example(tmp_path):
    """By this environment's packages: the empty one has them by a path, for no test uses the network."""
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp_path, ROOT]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.stat().st_size < LARGEST_WHEEL
    venv.create(tmp_path / "empty", with_pip=True)
    python = tmp_path / "empty" / "bin" / "python"
    install = [python, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", wheel]
    subprocess.run(install, check=True)
    (site,) = tmp_path.glob("empty/lib/python*/site-packages")
    (site / "others.pth").write_text(
        "\n".join(path for path in sys.path if "site-packages" in path)
    )
    run = {"cwd": tmp_path, "check": True, "capture_output": True, "text": True}
    sensor = tmp_path / "empty" / "bin" / "backlash"
    where = subprocess.run([python, "-c", "import backlash; print(backlash.__file__)"], **run)
    assert where.stdout.startswith(str(site))
    asked = subprocess.run([sensor, "example"], **run).stdout.splitlines()[-1]
    answered = subprocess.run([sensor, *asked.split()[1:]], **run)
    assert "backlash 0." in answered.stdout
