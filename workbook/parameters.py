"""What a student may change: a notebook's parameters."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from numbers import Integral, Real
from typing import Any

from replication.files import UserError


class ParameterError(UserError, ValueError):
    """A value that a parameter may not have."""

    def _render_traceback_(self) -> list[str]:
        """What Jupyter shows, above the outputs of cells that it does not come to."""
        return [f"{self} (what stands below is of an earlier run)"]


def is_number(value: Any) -> bool:
    """Whether a value is a real number, and no truth value."""
    return isinstance(value, Real) and not isinstance(value, bool)


def check_parameters(values: Mapping[str, Any], /, **allowed: Any) -> None:
    """Refuse a value that is not allowed, in one line.

    Parameters
    ----------
    values : mapping
        Values by name: a notebook's `globals()`.
    **allowed : pair, range, tuple, list or dict
        What each parameter may be: `(low, high)` for numbers between two ends, a `range` of whole numbers,
        a tuple of choices, which may hold `callable` for any function. `[allowed]` asks for a list
        with an item or more, `[allowed, []]` for one that may be empty, `{name: allowed}` for a
        mapping with some of these names.

    Raises
    ------
    ParameterError
        It names the parameter, its value, and what is allowed.

    Examples
    --------
    >>> check_parameters({"seed": 1.5}, seed=range(1, 1000))
    Traceback (most recent call last):
    workbook.parameters.ParameterError: seed = 1.5: it should be a whole number from 1 to 999
    """
    for name, may_be in allowed.items():
        _check(name, values[name], may_be)


def _check(name: str, value: Any, allowed: Any) -> None:
    match allowed:
        case list():
            words = "a list" if len(allowed) > 1 else "a list with an item or more"
            is_list = isinstance(value, Sequence) and not isinstance(value, str)
            is_allowed = is_list and (len(value) > 0 or len(allowed) > 1)
            for position, item in enumerate(value if is_allowed else []):
                _check(f"{name}[{position}]", item, allowed[0])
        case dict():
            words = "a mapping of some of " + ", ".join(map(repr, allowed))
            is_allowed = isinstance(value, Mapping) and set(value) <= set(allowed)
            for key, item in value.items() if is_allowed else ():
                _check(f"{name}[{key!r}]", item, allowed[key])
        case range():
            words = f"a whole number from {allowed[0]} to {allowed[-1]}"
            is_allowed = isinstance(value, Integral) and is_number(value) and value in allowed
        case (low, high) if is_number(low):
            words = f"a number from {low:g} to {high:g}"
            is_allowed = is_number(value) and low <= value <= high
        case _:
            words = "one of " + ", ".join(
                "a function" if each is callable else repr(each) for each in allowed
            )
            is_allowed = value in allowed or (callable in allowed and callable(value))
    if not is_allowed:
        raise ParameterError(f"{name} = {value!r}: it should be {words}")


def check_bounds(name: str, bounds: Mapping[str, Sequence[float]]) -> None:
    """Refuse a mapping in which a parameter has no lower and higher bound, in one line."""
    for parameter, ends in bounds.items():
        if len(ends) != 2 or ends[0] >= ends[1]:
            wrong = f"{name}[{parameter!r}] = {ends!r}"
            raise ParameterError(f"{wrong}: it should be a lower and a higher bound")


@contextmanager
def explain(name: str, value: object) -> Iterator[None]:
    """Say in one line which parameter a computation could not be done with."""
    try:
        yield
    except (ValueError, TypeError, RuntimeError) as error:
        raise ParameterError(f"{name} = {value!r}: {error}") from error
