"""A certificate says what ran here with this code, and names each file that is not as it is committed."""

import shutil
import subprocess

import pandas as pd
import pytest

from replication import records
from replication.files import DataUnavailable, UserError, as_json, write_kept
from workbook import certificate, judging, stamps
from workbook import project as project_module

NAMES = ("01_one", "02_two")
VERDICTS = pd.DataFrame(
    {
        "id": ["a", "b", "c", "d", "e"],
        "agreement": ["agrees", "agrees", "agrees", "differs", "not tested"],
        "weak": ["", "yes", "", "", ""],
        "source": ["recomputed", "recomputed", judging.CONSISTENT, "recomputed", "stand-in"],
        "notebook": ["01_one", "02_two", "01_one", "02_two", "02_two"],
    }
).set_index("id")


def git(folder, *words):
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    subprocess.run(["git", *who, *words], cwd=folder, check=True)


def leave(folder, name):
    """What a run of a notebook leaves."""
    source = folder / "notebooks" / f"{name}.py"
    made = {f"figures/{name}.svg": b"a figure", f"notebooks/{name}.ipynb": b"a notebook"}
    if name == stamps.REPORT:
        made, source = {"results/report.md": b"a report"}, None
    said = {"cells": [{"id": name, "source": "recomputed", "numbers": 1.0}]}
    record = stamps.add_record(said, stamps.digest_code(folder, source), {}, made)
    record_file = stamps.record_file(folder, name)
    made[record_file.relative_to(folder).as_posix()] = as_json(record)
    for each, content in made.items():
        (folder / each).parent.mkdir(exist_ok=True)
        (folder / each).write_bytes(content)
    (folder / ".make").mkdir(exist_ok=True)
    stamp = stamps.new_stamp(folder, [folder / each for each in made], 12)
    stamps.stamp_file(folder, name).write_bytes(stamp)


@pytest.fixture(params=["alone", "inside another repository"])
def clone(request, project, monkeypatch, tmp_path, authors=None):
    """A clone of two notebooks and a report that ran here, committed, with a kept table."""
    project_module.read_settings.cache_clear()
    folder = project(**dict.fromkeys(NAMES, "# %%\n"))
    if request.param != "alone":
        folder = shutil.copytree(folder, tmp_path / "inner", ignore=lambda *_: ["inner"])
        (tmp_path / ".gitignore").write_text("/notebooks\n/tools\n/results\n/*.*\n")
    (folder / "README.md").write_text("A readme.\n")
    (folder / ".gitignore").write_text(".make\n__pycache__\n")
    (folder / "tools" / "kept.py").write_text("print('x,y')\nprint('1,a')\n")
    write_kept(folder / "results" / "table.csv", pd.DataFrame({"x": [2, 1], "y": ["b", "a"]}))
    for name in (*NAMES, stamps.REPORT):
        leave(folder, name)
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", "-A")
    git(tmp_path, "commit", "-q", "-m", "made")
    monkeypatch.setattr(certificate, "ROOT", folder)
    monkeypatch.setattr(certificate, "RESULTS", folder / "results")
    monkeypatch.setattr(certificate, "notebook_sources", lambda: stamps.notebook_sources(folder))
    monkeypatch.setattr(certificate, "refuse_faults", lambda: stamps.refuse_faults(folder))
    monkeypatch.setattr(certificate, "list_data", dict)
    monkeypatch.setattr(judging, "verdicts", lambda results: VERDICTS)
    settings = stamps.read_settings(folder)
    monkeypatch.setattr(certificate, "read_settings", lambda root: settings)
    return folder


def certified(full=False):
    about = certificate.certify(full)
    return about, certificate.find_differences(about), certificate.write_certificate(about)


def test_where_nothing_ran_nothing_is_certified(clone):
    shutil.rmtree(clone / ".make")
    with pytest.raises(UserError, match="no notebook was run here"):
        certificate.certify()


def test_where_one_notebook_ran_the_others_and_their_numbers_stand_apart(clone):
    for name in (NAMES[1], stamps.REPORT):
        stamps.stamp_file(clone, name).unlink()
    _, differences, page = certified()
    assert differences == ["02_two: not run here", "report: not run here"]
    assert "| notebooks run here with this code | 1 of 2, 12 s in sum, " in page
    assert "| made here and the same | 3 of 3 files that were made here |" in page
    assert "not made here | table.csv; of what is made, " in page
    here = "1 agrees, 0 agrees weakly, 1 consistent, 0 differs, 0 not tested |"
    assert f"| printed numbers, by notebooks run here | {here}" in page
    others = "0 agrees, 1 agrees weakly, 0 consistent, 1 differs, 1 not tested |"
    assert f"| printed numbers, by committed outcomes | {others}" in page


def test_where_all_ran_to_the_same_bytes_there_is_no_difference(clone):
    about, differences, page = certified()
    assert (differences, about["changed"], len(about["commit"])) == ([], [], 40)
    assert "| notebooks run here with this code | 2 of 2, 24 s in sum, 1" in page
    assert "| made here and the same | 8 of 8 files" in page
    assert "| printed numbers, by committed outcomes | none |" in page
    assert "- no difference\n" in page


def test_after_a_code_change_that_is_committed_nothing_ran_with_this_code(clone):
    (clone / "tools" / "rules.py").write_text("population = 30\n")
    git(clone, "add", "-A")
    git(clone, "commit", "-q", "-m", "fewer")
    about, differences, page = certified()
    assert [f"{name}: not run here with this code" for name in (*NAMES, "report")] == differences[
        :3
    ]
    assert differences[3].startswith("no number is judged: 01_one: made by other code")
    assert "| notebooks run here with this code | 0 of 2," in page
    assert about["numbers"] == {}


CHANGES = ["figures/01_one.svg", "results/table.csv", "notebooks/01_one.ipynb", "tools/more.py"]


@pytest.mark.parametrize("name", CHANGES)
def test_a_byte_that_changes_is_named(clone, name):
    with (clone / name).open("a") as file:
        file.write(" ")
    about, differences, _ = certified()
    assert about["changed"] == [name]
    assert any(line.startswith(f"{name}: ") for line in differences)


def test_a_source_that_was_removed_is_named(clone):
    for name in ("notebooks/02_two.py", "README.md"):
        (clone / name).unlink()
    differences = certified()[1]
    assert "notebooks/02_two.py: changed since" in differences
    assert "README.md: not as committed" in differences


def test_a_notebook_that_lacks_its_data_is_said_and_is_no_difference(clone):
    lacks = stamps.new_stamp(clone, [], lacks="needs logs")
    stamps.stamp_file(clone, NAMES[1]).write_bytes(lacks)
    _, differences, page = certified()
    assert differences == []
    assert "- 02_two: not run: needs logs\n" in page


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("print('x,y')\nprint('1,a')\n", "- results/table.csv: a row: same"),
        ("print('x,y')\nprint('1,b')\n", "- results/table.csv: a row made again is another"),
        ("raise SystemExit('no logs')", "- results/table.csv: a row: not made again: no logs"),
    ],
)
def test_a_row_of_a_kept_table_is_made_again_where_that_is_asked_for(clone, code, says):
    (clone / "tools" / "kept.py").write_text(code)
    assert f"{says}\n" in certified(full=True)[2]


def test_runs_at_the_same_time_are_not_counted_twice_in_the_wall_time():
    runs = [{"seconds": 10, "ended": 100 + k} for k in (0, 5, 40)]
    assert certificate.sum_up_seconds(runs) == "30 s in sum, 25 s of wall time"


def test_data_that_could_not_be_had_are_one_line_and_a_changed_file_is_named(monkeypatch, tmp_path):
    def missing(name):
        raise DataUnavailable("no network")

    first = "Speeddata3.xlsx"
    monkeypatch.setattr(certificate, "find_hook", lambda name: missing)
    data = certificate._compare_data()
    assert {each["measured"] for each in data.values()} == {"no network"}
    (tmp_path / first).write_text("other")
    monkeypatch.setattr(certificate, "find_hook", lambda name: records.authors_file)
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    assert "not the registered one" in certificate._compare_data()[first]["measured"]
