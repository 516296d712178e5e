"""What a notebook was made from, and what it made: whatever is no longer so is due, whatever its time."""

import os
import shutil

import pytest

from replication.files import KEPT_SHA256, UserError, write_text
from workbook import stamps
from workbook.project import notebook_sources

NAME = "01_small"
# Its source, a module, data, and a table that the run read.
INPUTS = [f"notebooks/{NAME}.py", "tools/rules.py", "tools/data/cells.csv", "results/kept.csv"]
MADE = {"figures/one.svg": b"a figure", f"notebooks/{NAME}.ipynb": b"a notebook"}
CELL = [{"id": "a", "source": "recomputed", "numbers": 1.0}]


@pytest.fixture
def made(project, leave_run):
    """A project in which a notebook has run."""
    folder = project(**{NAME: "the source"})
    for name in INPUTS:
        write_text(folder / name, name)
    leave_run(NAME, {"cells": CELL, "claims": [], "facts": {}}, MADE, ["results/kept.csv"])
    assert stamps.find_due() == []
    stamps.refuse_faults()
    return folder


def write_with_old_time(file):
    """As `cp -p`, an archive, or a clock that is set back."""
    times = file.stat()
    file.write_text(file.read_text()[::-1])
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))


DAMAGES = {
    "gone": lambda file: file.unlink(),
    "another, of the same size and time": write_with_old_time,
    "a folder": lambda file: (file.unlink(), file.mkdir()),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize("name", [*INPUTS, *MADE, "requirements.lock"])
def test_an_input_or_a_result_that_is_gone_or_another_makes_its_notebook_due_or_is_refused(
    made, name, damage
):
    damage(made / name)
    assert stamps.find_due() or not notebook_sources()
    with pytest.raises(UserError, match=rf"^.*{NAME}.*$"):
        stamps.refuse_faults()


def test_a_damaged_table_of_times_is_one_line(made):
    write_text(made / "results" / "notebook_times.csv", "notebook,seconds\n01_one,many\n")
    with pytest.raises(UserError, match=r"notebook_times\.csv.*many"):
        stamps.find_due()


def test_a_new_module_makes_it_due_and_a_setting_too(made, work_on):
    (made / "tools" / "more.py").touch()
    assert stamps.find_due()
    (made / "tools" / "more.py").unlink()
    assert not stamps.find_due()
    with (made / "pyproject.toml").open("a") as file:
        file.write('more = "x"\n')
    work_on(made)
    assert stamps.find_due()


@pytest.mark.parametrize(
    "name",
    [".#rules.py", "rules.py~", "rules copy.py", "__pycache__/rules.cpython-311.pyc", ".DS_Store"],
)
def test_what_nothing_can_import_or_name_is_no_input(made, name):
    write_text(made / "tools" / name, "left by a program")
    assert not stamps.find_due()


def test_another_checkout_elsewhere_with_the_same_content_has_the_same_digest(
    made, tmp_path, work_on
):
    other = shutil.copytree(made, tmp_path.parent / "elsewhere")
    shutil.rmtree(other / ".make")
    work_on(other)
    assert stamps.find_fault(NAME) == ""
    assert stamps.find_why_due(NAME) == "not run here"


@pytest.mark.parametrize("text", ["", "12\n", "{", '{"seconds": 1, "made": {}}', "[" * 10**5])
def test_a_record_or_a_stamp_that_says_nothing_is_none(made, text):
    stamps.stamp_file(NAME).write_text(text)
    assert stamps.find_due()
    stamps.record_file(NAME).write_text(text)
    with pytest.raises(UserError, match=rf"{NAME}: results/outcomes/{NAME}\.json is missing, or"):
        stamps.refuse_faults()


def test_a_notebook_that_says_nothing_of_the_paper_may_be_older_than_the_code(made, leave_run):
    leave_run(NAME, stamps.NOTHING, MADE)
    (made / "tools" / "rules.py").write_text("other")
    assert stamps.find_due()
    stamps.refuse_faults()
    (made / "figures/one.svg").unlink()
    with pytest.raises(UserError, match=r"figures/one\.svg is missing, or not as it was made"):
        stamps.refuse_faults()


def test_a_number_that_is_changed_in_an_outcome_is_noticed_without_a_stamp(made):
    file = stamps.record_file(NAME)
    file.write_text(file.read_text().replace("1.0", "1.1"))
    assert stamps.find_why_due(NAME) == f"results/outcomes/{NAME}.json is not as it was made here"
    with pytest.raises(UserError, match=rf"{NAME}: what is said is missing, or not as it"):
        stamps.refuse_faults()


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("notebooks/01_small copy.py", "", r"copy\.py: a copy\?"),
        ("notebooks/01-small.py", "", r"01-small\.py: a copy\?"),
        ("notebooks/more/01_small.py", "", "has the same name; rename one"),
        ("results/outcomes/02_gone.json", "{}", "no notebook makes it; git checkout"),
        (f"results/{KEPT_SHA256}", '{"kept.csv": "0"}\n', "not the table that its study wrote"),
    ],
)
def test_what_is_a_copy_or_left_behind_or_changed_is_named(made, name, text, says):
    write_text(made / name, text)
    with pytest.raises(UserError, match=says):
        stamps.refuse_faults()


def test_compiled_code_of_other_sources_is_dropped_and_of_the_same_kept(made):
    compiled = made / "tools" / "__pycache__" / "rules.pyc"
    for change, stays in ((None, False), (None, True), ("other", False)):
        compiled.parent.mkdir(exist_ok=True)
        compiled.touch()
        if change:
            (made / "tools" / "rules.py").write_text(change)
        stamps.drop_stale_caches()
        assert compiled.exists() == stays
