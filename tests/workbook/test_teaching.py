"""What a notebook tells a student: whether an answer is right, and how long a notebook takes."""

import numpy as np
import pandas as pd
import pytest

from workbook import check_answer, say_times, teaching
from workbook.teaching import reading_minutes


@pytest.mark.parametrize(
    ("answer", "expected", "to", "printed"),
    [
        (-1, 1, 0.1, "not yet"),
        ([0, 1], [0, 1], 0.1, "right"),
        (3, lambda n: n > 2, 0.1, "right"),
        (np.array([1.05]), 1, 0.1, "right"),
        ([12], 12, 0, "right"),
        (np.roots([1, -1, -2]).astype(complex)[0], 2, 0.1, "right"),
        (1 + 1j, 1, 0.1, "not yet: (1+1j) is not a number"),
        (1, [1, 1], 0.1, "not yet"),
        (11.36, 12, 0, "not yet: a whole number is asked for"),
        ("one", 1, 0.1, "not yet: 'one' is not a number"),
        ([1, [2]], [1, 2], 0.1, "not yet: [2] is not a number"),
        (np.nan, 1, 0.1, ""),
        (np.nan, [1, 2], 0.1, ""),
        (np.nan, lambda n: 1 / 0, 0.1, ""),
    ],
)
def test_an_answer_is_right_or_not_yet_and_of_one_that_is_not_there_nothing_is_said(
    answer, expected, to, printed, capsys
):
    check_answer(answer, expected, to)
    assert capsys.readouterr().out == (f"{printed}\n" if printed else "")


SOURCE = """# %% [markdown]
# # A title
#
# $$a = b$$

# %% tags=["hide-input"]
folded = 1
workbook.show(figure, "three words more")

# %%
visible = 1
other = 2
visible

# %% tags=["solution"]
unread = 1
"""


@pytest.fixture
def said(tmp_path, monkeypatch):
    """What is said of two notebooks of the same source."""
    (tmp_path / "small.py").write_text(SOURCE, "utf-8")
    sources = dict.fromkeys(("one", "two"), tmp_path / "small.py")
    monkeypatch.setattr(teaching, "notebook_sources", lambda: sources)
    sentences = []
    monkeypatch.setattr(teaching, "say", sentences.append)
    return sentences


def test_the_reading_time_counts_words_code_equations_figures_and_tables(said):
    words = 3  # with the title's mark
    assert reading_minutes("one") == pytest.approx(words / 150 + 3 / 12 + 1 + 0.5 + 0.5)


def test_a_path_says_how_long_its_notebooks_and_exercises_take(said, monkeypatch):
    monkeypatch.setattr(teaching, "reading_minutes", lambda name: 33)
    teaching.say_path("one", "two")
    assert said == [
        "*The path in all: 1.1 h to read, and 0.2 h for its 2 exercises, if one takes 5 min.*"
    ]


def test_a_head_says_the_measured_time_and_none_where_none_was_measured(said, monkeypatch):
    monkeypatch.setattr(teaching, "reading_minutes", lambda name: 19.6)
    times = pd.DataFrame({"notebook": ["one", "two"], "seconds": [31, 30]})
    monkeypatch.setattr(teaching, "read_kept", lambda name: times)
    for name in ("one", "two", "new"):
        say_times(name)
    assert said == [
        f"*Reading time: 20 min. Run time: {run}.*" for run in ("1 min", "0.5 min", "not measured")
    ]
