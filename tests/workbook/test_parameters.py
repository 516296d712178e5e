"""A wrong value of a notebook's parameter gets one sentence with what there is; sliders move the others."""

import sys
from types import ModuleType

import pytest

from workbook import Interval, check_parameters, sliders


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
        d=([], [Interval(0)]),
        e=(len, ("x", callable)),
    )


@pytest.mark.parametrize("by_hand", [False, True])
def test_a_picture_is_drawn_once_and_by_hand_has_sliders_with_their_first_values_and_ends(
    by_hand, monkeypatch
):
    shown, drawn = {}, []
    widgets = ModuleType("ipywidgets")
    widgets.FloatSlider = lambda first, **options: (first, options["min"], options["max"])
    widgets.interact = lambda draw, **made: shown.update(made)
    monkeypatch.setitem(sys.modules, "ipywidgets", widgets)
    monkeypatch.setattr("workbook.parameters.find_spec", lambda name: widgets)
    monkeypatch.setenv("REPLICATION_OUT", "x")
    if by_hand:
        monkeypatch.delenv("REPLICATION_OUT")
    sliders(lambda **values: drawn.append(values), alpha=(4.0, 3.0, 6.0), delta=(1.5, 0.3, 2.1))
    assert drawn == [{"alpha": 4.0, "delta": 1.5}]  # stays in the saved notebook
    assert shown == ({"alpha": (4.0, 3.0, 6.0), "delta": (1.5, 0.3, 2.1)} if by_hand else {})
