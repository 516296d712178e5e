"""The kept tables are what today's code makes: rows of each are made again, to the digit."""

import importlib.util
import json
import os
import subprocess
import sys
from inspect import signature
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from replication.compilation import pinned_environment
from replication.files import KEPT_SHA256, ROOT, UserError, check_kept, write_kept
from studies import kept
from studies.kept import KEPT, TIMED
from workbook.project import notebook_sources
from workbook.stamps import list_made

RESULTS = ROOT / "results"
# The first needs a library, the second ten seconds; the others need files.
ALONE = ("engine", "table2_prediction")
TOGETHER = [name for name in KEPT if name not in ALONE]
# What a table's rows are made from, where it is not the authors' files: a variable that names a folder.
FOLDERS = {"hardware": "HARDWARE_LOGS"}
OF_REPORT = {"verdicts", "claims"}
# A call gives several rows that its arguments do not tell apart.
AT_ONCE = {"alpha_refit", "refusals"}


def find_lacking(name):
    """Say what a table's rows are made from and is not there; "" if nothing."""
    if name == "engine":
        return "" if importlib.util.find_spec("mujoco") else "needs mujoco"
    folder = FOLDERS.get(name, "BACKLASH_DATA")
    return "" if Path(os.environ.get(folder, "nowhere")).is_dir() else f"needs the folder {folder}"


def check(rows):
    """Compare rows of kept tables, as text, with the same made again, all in one process, which takes long to start.

    Skip those that cannot be made here.
    """
    lacking = {name: find_lacking(name) for name in rows}
    rows = {name: rows[name] for name in rows if not lacking[name]}
    if not rows:
        pytest.skip(", ".join(sorted({*lacking.values()})))
    expected = []
    for name, positions in rows.items():
        head, *lines = (RESULTS / f"{name}.csv").read_text("utf-8").splitlines()
        expected += [head, *(lines[position] for position in positions)]
    arguments = [f"{name}:{','.join(map(str, positions))}" for name, positions in rows.items()]
    command = [sys.executable, "-m", "studies.kept", *arguments]
    pinned = os.environ | pinned_environment()
    ran = subprocess.run(command, cwd=ROOT, env=pinned, stdout=subprocess.PIPE, check=True)
    again = " and ".join({f"make studies NAME={KEPT[name].study}" for name in rows})
    assert ran.stdout.decode().splitlines() == expected, f"{again} makes the table again"


def test_every_table_is_made_by_a_notebook_or_the_report_or_kept():
    exports = {file for name in notebook_sources() for file in list_made(name)}
    tables = {f"results/{file.name}" for file in RESULTS.glob("*.csv")}
    others = {f"results/{name}.csv" for name in (*KEPT, *TIMED, *OF_REPORT)}
    assert tables - exports - others == set()


@pytest.mark.parametrize("name", [name for name in KEPT if name not in AT_ONCE])
def test_the_rows_of_a_kept_table_are_those_that_its_study_plans(name):
    planned = pd.DataFrame(KEPT[name].plan(), columns=[*signature(KEPT[name].measure).parameters])
    table = pd.read_csv(RESULTS / f"{name}.csv")[planned.columns]
    made = table.drop_duplicates(ignore_index=True)
    pd.testing.assert_frame_equal(planned, made, check_dtype=False)


def test_a_study_writes_the_rows_of_its_plan_and_makes_any_of_them_again(tmp_path, monkeypatch):
    def measure(a):
        return [{"a": a, "b": 10 * a + k} for k in (1, 2)]

    made = {"made": kept.Kept("study", measure, lambda: [(1,), (2,)])}
    for name, value in (("RESULTS", tmp_path), ("STUDIES", ["study"]), ("KEPT", made)):
        monkeypatch.setattr(kept, name, value)
    kept.write_study("study")
    assert (tmp_path / "made.csv").read_text().split() == ["a,b", "1,11", "1,12", "2,21", "2,22"]
    assert [*kept.remake("made", [3, 0])] == ["a,b", "2,22", "1,11"]


def test_every_kept_table_is_as_its_study_wrote_it():
    digests = json.loads((RESULTS / KEPT_SHA256).read_text("utf-8"))
    assert digests.keys() == {f"{name}.csv" for name in (*KEPT, *TIMED)}
    for name in digests:
        check_kept(RESULTS / name)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("one.csv", "x\n2\n"),
        (KEPT_SHA256, None),
        (KEPT_SHA256, "{"),
        (KEPT_SHA256, "[1]\n"),
        (KEPT_SHA256, '{"two.csv": "00"}\n'),
    ],
)
def test_a_kept_table_that_nothing_says_was_written_so_is_refused(name, text, tmp_path):
    file = tmp_path / "one.csv"
    write_kept(file, pd.DataFrame({"x": [1]}))
    write_kept(tmp_path / "two.csv", pd.DataFrame({"x": [3]}))
    check_kept(file)
    (tmp_path / name).write_text(text) if text else (tmp_path / name).unlink()
    with pytest.raises(UserError, match="git checkout brings it back"):
        check_kept(file)


@pytest.mark.slow
@pytest.mark.parametrize("names", [*([each] for each in ALONE), TOGETHER], ids=[*ALONE, "others"])
def test_a_row_of_a_kept_table_made_again_is_the_kept_one(names):
    check({name: [KEPT[name].first] for name in names})


@pytest.mark.slow
@pytest.mark.parametrize("name", KEPT)
def test_ten_other_rows_of_a_kept_table_made_again_are_the_kept_ones(name):
    rows = len((RESULTS / f"{name}.csv").read_text("utf-8").splitlines()) - 1
    check({name: [*np.unique(np.linspace(0, rows - 1, 11).astype(int))]})
