"""A parameter's value is allowed, or refused in one line that says what is."""

import pytest

from workbook import Interval, check_parameters
from workbook.parameters import ParameterError

SEEDS = range(1, 1000)


@pytest.mark.parametrize(
    ("value", "allowed"),
    [
        (0.5, Interval(0, 2.1)),
        (3, Interval(1)),
        (7, SEEDS),
        ("normal", ("uniform", "normal")),
        (abs, ("L1", callable)),
        ([1, 2], [SEEDS]),
        ([], [SEEDS, []]),
        ({"tau": 1.2}, {"tau": Interval(0), "omega": Interval(0)}),
        ({}, {"tau": Interval(0)}),
    ],
)
def test_what_is_allowed_passes(value, allowed):
    check_parameters(name=(value, allowed))


@pytest.mark.parametrize(
    ("value", "allowed", "says"),
    [
        (2.2, Interval(0, 2.1), "a number from 0 to 2.1"),
        (float("nan"), Interval(0), "a number from 0 on"),
        ("0.5", Interval(0, 2.1), "a number"),
        (True, Interval(0, 2.1), "a number"),
        (1.5, SEEDS, "a whole number from 1 to 999"),
        (1.0, SEEDS, "a whole number"),
        ("gauss", ("uniform", "normal"), "one of 'uniform', 'normal'"),
        ("L2", ("L1", callable), "one of 'L1', a function"),
        (3, [SEEDS], "a list, each item a whole number"),
        ([], [SEEDS], "a list"),
        ([1, 0], [SEEDS], "a list, each item a whole number"),
        ({"rho": 1.2}, {"tau": Interval(0)}, "'tau': a number from 0 on"),
        ({"tau": -1}, {"tau": Interval(0)}, "'tau': a number from 0 on"),
    ],
)
def test_what_is_not_allowed_is_refused_in_one_line_with_what_is(value, allowed, says):
    with pytest.raises(ParameterError) as refused:
        check_parameters(name=(value, allowed))
    line = str(refused.value)
    assert line.startswith(f"name = {value!r}: it should be ")
    assert says in line
    assert "\n" not in line
