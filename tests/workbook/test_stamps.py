"""What a notebook was made from, and what it made: whatever is no longer so is due, whatever its time."""

import os
import shutil

import pytest

from replication.files import UserError, as_json
from workbook import project as project_module
from workbook import stamps

NAME = "01_small"
INPUTS = {
    "notebooks/01_small.py": "the source",
    "tools/rules.py": "a module",
    "tools/data/cells.csv": "data",
    "results/kept.csv": "a table that the run read",
}
MADE = ["figures/one.svg", "notebooks/01_small.ipynb"]
CELL = [{"id": "a", "source": "recomputed", "numbers": 1.0}]


@pytest.fixture
def made(project):
    """A project in which a notebook has run."""
    project_module.read_settings.cache_clear()
    folder = project(**{NAME: ""})
    for name in (*INPUTS, *MADE):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
    code = stamps.digest_code(folder, folder / "notebooks" / f"{NAME}.py")
    read = {"results/kept.csv": stamps.sha256(folder / "results" / "kept.csv")}
    said = {"cells": CELL, "claims": [], "facts": {}}
    record = stamps.add_record(said, code, read, {name: name.encode() for name in MADE})
    file = stamps.record_file(folder, NAME)
    file.parent.mkdir()
    file.write_bytes(as_json(record))
    stamp = stamps.stamp_file(folder, NAME)
    stamp.parent.mkdir()
    stamp.write_bytes(stamps.new_stamp(folder, [file, *(folder / name for name in MADE)], 12.3))
    assert stamps.find_due(folder) == []
    stamps.refuse_faults(folder)
    return folder


def write_with_old_time(file):
    """As `cp -p`, an archive, or a clock that is set back."""
    times = file.stat()
    file.write_text(file.read_text()[::-1])
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))


DAMAGES = {
    "gone": lambda file: file.unlink(),
    "emptied": lambda file: file.write_text(""),
    "another, of the same size and time": write_with_old_time,
    "a folder": lambda file: (file.unlink(), file.mkdir()),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize("name", [*INPUTS, *MADE, "requirements.lock"])
def test_an_input_or_a_result_that_is_gone_or_another_makes_its_notebook_due_or_is_refused(
    made, name, damage
):
    damage(made / name)
    if name == "notebooks/01_small.py" and not (made / name).is_file():
        assert not stamps.notebook_sources(made) or stamps.find_due(made)
    else:
        assert [each.stem for each in stamps.find_due(made)] == [NAME]
    with pytest.raises(UserError) as refused:
        stamps.refuse_faults(made)
    assert "\n" not in str(refused.value)
    assert NAME in str(refused.value)


def test_a_new_module_makes_it_due_and_a_setting_too(made):
    (made / "tools" / "more.py").touch()
    assert stamps.find_due(made)
    (made / "tools" / "more.py").unlink()
    assert not stamps.find_due(made)
    with (made / "pyproject.toml").open("a") as file:
        file.write('more = "x"\n')
    project_module.read_settings.cache_clear()
    assert stamps.find_due(made)


@pytest.mark.parametrize(
    "name",
    [".#rules.py", "rules.py~", "rules copy.py", "__pycache__/rules.cpython-311.pyc", ".DS_Store"],
)
def test_what_nothing_can_import_or_name_is_no_input(made, name):
    file = made / "tools" / name
    file.parent.mkdir(exist_ok=True)
    file.write_text("left by a program")
    assert not stamps.find_due(made)


def test_another_checkout_elsewhere_with_the_same_content_has_the_same_digest(made, tmp_path):
    other = shutil.copytree(made, tmp_path.parent / "elsewhere")
    shutil.rmtree(other / ".make")
    assert stamps.find_fault(other, NAME) == ""
    assert stamps.find_why_due(other, NAME) == "not run here"


@pytest.mark.parametrize("text", ["", "12\n", "{", '{"seconds": 1, "made": {}}', "[" * 10**5])
def test_a_record_or_a_stamp_that_says_nothing_is_none(made, text):
    stamps.stamp_file(made, NAME).write_text(text)
    assert stamps.find_due(made)
    stamps.record_file(made, NAME).write_text(text)
    with pytest.raises(
        UserError, match=r"01_small: results/outcomes/01_small\.json is missing, or"
    ):
        stamps.refuse_faults(made)


def test_a_notebook_that_says_nothing_of_the_paper_may_be_older_than_the_code(made):
    file = stamps.record_file(made, NAME)
    code = stamps.digest_code(made, made / "notebooks" / f"{NAME}.py")
    file.write_bytes(
        as_json(stamps.add_record({"cells": []}, code, {}, {MADE[0]: MADE[0].encode()}))
    )
    (made / "tools" / "rules.py").write_text("other")
    assert stamps.find_due(made)
    stamps.refuse_faults(made)
    (made / MADE[0]).unlink()
    with pytest.raises(UserError, match=r"figures/one\.svg is missing, or not as it was made"):
        stamps.refuse_faults(made)


def test_a_number_that_is_changed_in_an_outcome_is_noticed_without_a_stamp(made):
    shutil.rmtree(made / ".make")
    stamps.refuse_faults(made)
    file = stamps.record_file(made, NAME)
    file.write_text(file.read_text().replace("1.0", "1.1"))
    with pytest.raises(UserError, match=r"01_small: what is said is missing, or not as it"):
        stamps.refuse_faults(made)


@pytest.mark.parametrize("name", ["01_small copy", "01-small"])
def test_a_copy_that_a_cloud_made_is_named(made, name):
    (made / "notebooks" / f"{name}.py").touch()
    with pytest.raises(UserError, match=rf"{name}\.py: a copy\?"):
        stamps.find_due(made)


def test_compiled_code_of_other_sources_is_dropped_and_of_the_same_kept(made):
    compiled = made / "tools" / "__pycache__" / "rules.pyc"
    for change, stays in ((None, False), (None, True), ("other", False)):
        compiled.parent.mkdir(exist_ok=True)
        compiled.touch()
        if change:
            (made / "tools" / "rules.py").write_text(change)
        stamps.drop_stale_caches(made)
        assert compiled.exists() == stays
