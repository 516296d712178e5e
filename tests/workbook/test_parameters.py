"""A parameter's value is allowed, or refused in one line that says what is."""

import numpy as np
import pytest

from workbook import ParameterError, check_bounds, check_parameters

SEEDS = range(1, 1000)
NAMES = {"tau": (0, np.inf), "omega": (0, np.inf)}


@pytest.mark.parametrize(
    ("value", "allowed"),
    [
        (0.5, (0, 2.1)),
        ("normal", ("uniform", "normal")),
        (abs, ("L1", callable)),
        ([1, 2], [SEEDS]),
        ([], [SEEDS, []]),
        ({"tau": 1.2}, NAMES),
    ],
)
def test_what_is_allowed_passes(value, allowed):
    check_parameters({"name": value}, name=allowed)


def test_a_parameter_without_a_lower_and_a_higher_bound_is_named():
    check_bounds("box", {"tau": (0, 1)})
    for ends in ((1,), (1, 1), (2, 1)):
        with pytest.raises(ParameterError, match=r"^box\['tau'\] = .* a lower and a higher bound$"):
            check_bounds("box", {"tau": ends})


@pytest.mark.parametrize(
    ("value", "allowed", "line"),
    [
        (2.2, (0, 2.1), "name = 2.2: it should be a number from 0 to 2.1"),
        (float("nan"), (0, np.inf), "name = nan: it should be a number from 0 to inf"),
        (True, (0, np.inf), "name = True: it should be a number from 0 to inf"),
        (1.0, SEEDS, "name = 1.0: it should be a whole number from 1 to 999"),
        ("a", ("L1", callable), "name = 'a': it should be one of 'L1', a function"),
        ([], [SEEDS], "name = []: it should be a list with an item or more"),
        ([1, 0], [SEEDS], "name[1] = 0: it should be a whole number from 1 to 999"),
        ({"rho": 1}, NAMES, "name = {'rho': 1}: it should be a mapping of some of 'tau', 'omega'"),
        ({"tau": -1}, NAMES, "name['tau'] = -1: it should be a number from 0 to inf"),
    ],
)
def test_what_is_not_allowed_is_refused_in_one_line_with_what_is(value, allowed, line):
    with pytest.raises(ParameterError) as refused:
        check_parameters({"name": value}, name=allowed)
    assert str(refused.value) == line
