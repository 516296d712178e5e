import platform
import subprocess
import sys

import pytest

from replication.studies import portable
from replication.studies.portable import KERNELS, SETTINGS, Outcome, Setting

X86_64 = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="these settings are x86-64's")
PLAINEST = SETTINGS[-1]


def outcome(name, **verdicts):
    return Outcome(name, "", "", (), {(key, "authors"): verdict for key, verdict in verdicts.items()}, 0.0)


def in_a_process(environment, call):
    command = [sys.executable, "-c", f"from replication.studies.portable import *; print({call})"]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_the_settings_have_every_kernel_and_all_pairs_of_numba_and_numpy():
    assert {setting.kernel for setting in SETTINGS} == set(KERNELS)
    assert {(setting.generic, setting.simd) for setting in SETTINGS} == {
        (generic, simd) for generic in (True, False) for simd in (True, False)
    }
    assert len({setting.name for setting in SETTINGS}) == len(SETTINGS)
    assert (PLAINEST.kernel, PLAINEST.generic, PLAINEST.simd) == ("Prescott", True, False)


@X86_64
def test_a_setting_is_in_effect_in_a_process_of_its_own_whatever_was_set_before(monkeypatch):
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Haswell")
    monkeypatch.setenv("NUMBA_CPU_NAME", "haswell")
    monkeypatch.setenv("NPY_DISABLE_CPU_FEATURES", "X86_V4")
    done = in_a_process(PLAINEST.environment(), f"check_setting(setting_named({PLAINEST.name!r}))")
    assert done.returncode == 0, done.stderr
    assert "numba generic; NumPy without SIMD" in done.stdout


@X86_64
@pytest.mark.parametrize(
    "other", [Setting("Haswell", True, False), Setting("Prescott", False, False), Setting("Prescott", True, True)]
)
def test_a_setting_of_which_one_thing_is_missing_is_not_in_effect(other):
    done = in_a_process(PLAINEST.environment(), f"check_setting({other!r})")
    assert done.returncode == 1
    assert "NotInEffect" in done.stderr


@X86_64
def test_tests_run_under_their_setting_and_a_failure_is_named(tmp_path):
    tests = tmp_path / "test_two.py"
    tests.write_text(
        "import os\n"
        "def test_the_generic_processor_is_set(): assert os.environ['NUMBA_CPU_NAME'] == 'generic'\n"
        "def test_wrong(): assert 1 == 2\n"
    )
    effect, last_line, failures = portable.run_tests(PLAINEST, [str(tests)])
    assert "numba generic" in effect
    assert "1 failed, 1 passed" in last_line
    assert len(failures) == 1
    assert "test_wrong" in failures[0]


@X86_64
def test_tests_do_not_run_where_the_setting_is_not_in_effect(tmp_path, monkeypatch):
    tests = tmp_path / "test_one.py"
    tests.write_text("def test_right(): pass\n")
    wrong = SETTINGS[1].environment() | {portable.SETTING_VARIABLE: PLAINEST.name}
    monkeypatch.setattr(Setting, "environment", lambda self: wrong)
    _, _, failures = portable.run_tests(PLAINEST, [str(tests)])
    assert "is not in effect" in failures[0]


@X86_64
def test_a_notebook_is_run_to_its_verdicts_and_one_that_fails_is_named(tmp_path):
    failing = tmp_path / "99_failing.py"
    failing.write_text("raise ValueError('no such thing')\n")
    dead_zone = next(path for path in portable.cheap_notebooks() if path.stem.startswith("02"))
    verdicts, failures = portable.run_notebooks(PLAINEST, tmp_path, [failing, dead_zone])
    assert failures == ["99_failing: ValueError: no such thing"]
    assert verdicts
    assert set(verdicts.values()) <= {"holds", "does not hold", "undecided"}


def test_the_cheap_notebooks_are_those_whose_quick_run_is_their_whole_run():
    names = [path.stem[:2] for path in portable.cheap_notebooks()]
    assert names == ["01", "02", "03", "04", "05", "06"]


def test_a_cell_whose_verdict_hangs_on_the_setting_is_named_with_both_verdicts():
    same = [outcome("one", a="reproduced", b="differs"), outcome("two", a="reproduced", b="differs")]
    assert portable.differing(same) == []
    (line,) = portable.differing([*same, outcome("three", a="undecided", b="differs")])
    assert line == "a (authors): reproduced with one, reproduced with two, undecided with three"
    (line,) = portable.differing([*same, outcome("four", a="reproduced")])
    assert "none with four" in line
    assert portable.table([*same, outcome("three", a="undecided")])["differing"].tolist() == [0, 0, 2]


@X86_64
def test_a_kernel_that_the_processor_cannot_run_is_left_out_and_said(monkeypatch):
    monkeypatch.setattr(portable, "get_host_cpu_features", lambda: {"avx2": True, "avx512bw": False})
    able, unable = portable.settings_here()
    assert {setting.kernel for setting in able} == {"Haswell", "Zen", "Prescott"}
    assert unable == ["skylakex-here-simd not tried: this processor has no avx512bw"]


def test_an_unknown_setting_and_another_machine_are_refused(monkeypatch):
    with pytest.raises(ValueError, match="there are skylakex-here-simd"):
        portable.setting_named("386")
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    with pytest.raises(portable.OtherMachine, match="aarch64"):
        portable.settings_here()
