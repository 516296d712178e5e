"""A notebook's parameters: what they may be, and pictures that they move."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from numbers import Integral, Real
from typing import Any, NamedTuple

from replication.records import UserError
from workbook.outcomes import OUTPUT_FOLDER


class ParameterError(UserError, ValueError):
    """A value that a parameter may not have."""


class Interval(NamedTuple):
    """Numbers from `low` to `high`; whole ones are those of a `range`."""

    low: float
    high: float = math.inf


def check_parameters(**parameters: tuple[Any, Any]) -> None:
    """Refuse a value that is not allowed, in one line.

    Parameters
    ----------
    **parameters : (value, allowed)
        A parameter's value, and what it may be: an `Interval` of numbers, a `range` of whole numbers,
        a tuple of choices, which may hold `callable` for any function. `[allowed]` asks for a list
        with an item or more, `[allowed, []]` for one that may be empty, `{name: allowed}` for a
        mapping with some of these names.

    Raises
    ------
    ParameterError
        It names the parameter, its value, and what is allowed.

    Examples
    --------
    >>> check_parameters(seed=(1.5, range(1, 1000)))
    Traceback (most recent call last):
    workbook.parameters.ParameterError: seed = 1.5: it should be a whole number from 1 to 999
    """
    for name, (value, allowed) in parameters.items():
        if not _is_allowed(value, allowed):
            raise ParameterError(f"{name} = {value!r}: it should be {_describe(allowed)}")


@contextmanager
def explain(name: str, value: object) -> Iterator[None]:
    """Say in one line which parameter a computation could not be done with."""
    try:
        yield
    except (ValueError, TypeError, RuntimeError) as error:
        raise ParameterError(f"{name} = {value!r}: {error}") from error


def _is_allowed(value: Any, allowed: Any) -> bool:
    match allowed:
        case Interval():
            is_number = isinstance(value, Real) and not isinstance(value, bool)
            return is_number and allowed.low <= value <= allowed.high
        case range():
            return isinstance(value, Integral) and value in allowed and not isinstance(value, bool)
        case [each, *or_empty] if isinstance(allowed, list):
            is_list = isinstance(value, list | tuple | range) and (len(value) > 0 or bool(or_empty))
            return is_list and all(_is_allowed(item, each) for item in value)
        case dict():
            is_mapping = isinstance(value, Mapping) and set(value) <= set(allowed)
            return is_mapping and all(_is_allowed(value[key], allowed[key]) for key in value)
        case _:
            return value in allowed or (callable in allowed and callable(value))


def _describe(allowed: Any) -> str:
    match allowed:
        case Interval(low, high):
            return f"a number from {low:g}" + (f" to {high:g}" if math.isfinite(high) else " on")
        case range():
            return f"a whole number from {allowed[0]} to {allowed[-1]}"
        case [each, *_] if isinstance(allowed, list):
            return f"a list, each item {_describe(each)}"
        case dict():
            return "a mapping of " + "; ".join(f"{k!r}: {_describe(v)}" for k, v in allowed.items())
        case _:
            return "one of " + ", ".join(
                "a function" if each is callable else repr(each) for each in allowed
            )


def sliders(draw: Callable[..., None], **ranges: tuple[float, float, float]) -> None:
    """Draw a picture, and below it, by hand in JupyterLab, the same with a slider for each argument.

    A range holds an argument's first value and its ends. The picture that is drawn without sliders
    stays in the saved notebook.
    """
    draw(**{name: first for name, (first, _, _) in ranges.items()})
    if OUTPUT_FOLDER or not find_spec("ipywidgets"):
        return
    from ipywidgets import FloatSlider, interact

    made = {
        name: FloatSlider(
            first, min=low, max=high, step=(high - low) / 100, continuous_update=False
        )
        for name, (first, low, high) in ranges.items()
    }
    interact(draw, **made)
