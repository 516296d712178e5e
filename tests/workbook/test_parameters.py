"""A wrong value of a notebook's parameter gets one sentence with what there is; sliders move the others."""

import pytest

from workbook import Interval, check_parameters


@pytest.mark.parametrize(
    ("value", "allowed", "sentence"),
    [
        (14, range(3, 6), "shown = 14: 14 should be one of 3, 4, 5"),
        ([2, "x"], [Interval(1, 5)], "shown = [2, 'x']: 'x' should be a number from 1 to 5"),
        (3.0, [Interval(0)], "shown = 3.0: it should be a list, each item a number from 0 on"),
        ([1], range(3), "shown = [1]: it should be one of 0, 1, 2"),
        (
            {"rigidity": 2},
            [("stiffness",)],
            "shown = {'rigidity': 2}: 'rigidity' should be one of 'stiffness'",
        ),
        (2.5, Interval(1, 9, whole=True), "shown = 2.5: 2.5 should be a whole number from 1 to 9"),
        (
            [],
            [Interval(0, 1)],
            "shown = []: it should have an item or more, each a number from 0 to 1",
        ),
        (
            {"load_frictoin": 1},
            {"load_friction": Interval(0)},
            "shown = {'load_frictoin': 1}: 'load_frictoin' should be one of 'load_friction'; "
            "did you mean 'load_friction'?",
        ),
        (
            {"load_friction": -1},
            {"load_friction": Interval(0)},
            "load_friction = -1: -1 should be a number from 0 on",
        ),
        (float("nan"), Interval(0, 1), "shown = nan: nan should be a number from 0 to 1"),
    ],
)
def test_a_value_that_is_not_allowed_is_refused_with_what_is(value, allowed, sentence):
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        check_parameters(shown=(value, allowed))
    assert str(caught.value) == sentence
    assert caught.value._render_traceback_() == [sentence]  # all that Jupyter shows


def test_what_is_allowed_passes():
    check_parameters(
        a=(3, range(5)),
        b=([0.1, 2], [Interval(0, 2)]),
        c=({}, [("x",)]),
        d=([], [Interval(0), []]),
        e=(len, ("x", callable)),
    )
