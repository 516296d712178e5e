"""What notebooks propose to change is allowed, what is not allowed is refused; what comes out, `make changes` tests."""

import pytest

from tests.changes import NOTEBOOKS, changes, check, parse, run, says_what_happened


@pytest.mark.parametrize("notebook", NOTEBOOKS)
def test_a_notebook_proposes_three_changes_and_allows_them(notebook):
    proposed = changes(notebook)
    assert len(proposed) == 3
    for change in proposed:
        check(notebook, parse(change))


def test_a_notebook_runs_with_a_change_names_it_and_says_what_happened(tmp_path, capsys):
    change = parse(changes("02_dead_zone_figure9")[0])
    run("02_dead_zone_figure9", change, tmp_path)
    assert says_what_happened(capsys.readouterr().out, change)


@pytest.mark.parametrize(
    ("notebook", "wrong", "said"),
    [
        (
            "10_bench_table3",
            {"spread": {"load_frictoin": 0.05}},
            "'load_frictoin' should be one of .*'load_friction'",
        ),
        (
            "19_friction",
            {"judged_shares": [0.033]},
            r"judged_shares = \[0.033\]: 0.033 should be one of",
        ),
        (
            "12_your_own_joint",
            {"method": "wave"},
            "should be one of 'amplitude', 'energy', 'waveform'",
        ),
        (
            "11_robots_table4",
            {"repeats": 2.5},
            "repeats = 2.5: 2.5 should be a whole number from 2 to 1000",
        ),
    ],
)
def test_a_wrong_value_is_refused_in_one_sentence(notebook, wrong, said):
    with pytest.raises(ValueError, match=said):
        check(notebook, wrong)
