"""A notebook's parameters: what they may be, and pictures that they move."""

import math
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import partialmethod
from importlib.util import find_spec
from typing import Any

import pandas as pd
from tqdm import tqdm

from replication.files import UserError

# Every notebook checks its parameters before it shows a table: tables in full.
pd.set_option("display.max_colwidth", None, "display.max_columns", None, "display.max_rows", 200)
# A notebook that is run by hand shows standard error in red: progress bars go to standard output.
if "JPY_PARENT_PID" in os.environ and "REPLICATION_OUT" not in os.environ:
    tqdm.__init__ = partialmethod(tqdm.__init__, file=sys.stdout)


class ParameterError(UserError, ValueError):
    """A value that a parameter may not have."""


@dataclass(frozen=True)
class Interval:
    """Numbers from `low` to `high`, as what a parameter may be."""

    low: float
    high: float = math.inf
    whole: bool = False

    def __contains__(self, value: object) -> bool:
        return (
            isinstance(value, int if self.whole else int | float) and self.low <= value <= self.high
        )

    def __str__(self) -> str:
        above = f" to {self.high:g}" if math.isfinite(self.high) else " on"
        return f"a {'whole ' if self.whole else ''}number from {self.low:g}{above}"


# Values of the notebook that runs, by the parameter's name.
GIVEN: dict[str, Any] = {}


def check_parameters(**parameters: tuple[Any, Any]) -> None:
    """Refuse in one sentence a value that is not allowed; of a list each item, of a mapping each key.

    Each parameter comes with its value and what is allowed: an `Interval` or a collection, which may
    hold `callable` for any function. A list of one of these asks for a list with an item or more, and
    with `[]` as second item for any list. A mapping of them asks for a mapping with some of its keys,
    each with a value that is allowed there.
    """
    for name, (value, allowed) in parameters.items():
        _check(name, value, allowed)
        GIVEN[name] = value


def _check(name: str, value: Any, allowed: Any) -> None:
    said = f"{name} = {value!r}"
    by_key = isinstance(allowed, dict) and all(
        isinstance(each, Interval | list | tuple) for each in allowed.values()
    )
    if is_list := isinstance(allowed, list) or by_key:
        allowed, *or_empty = [allowed] if by_key else allowed
    if isinstance(allowed, range) and len(allowed) > 20:
        allowed = Interval(allowed[0], allowed[-1], whole=True)
    choices = str(allowed)
    if not isinstance(allowed, Interval):
        choices = "one of " + ", ".join(map(repr, allowed))
        choices = choices.replace(repr(callable), "a function")
    if is_list != isinstance(value, list | tuple | range | Mapping):
        wanted = f"a list, each item {choices}" if is_list else choices
        raise ParameterError(f"{said}: it should be {wanted}")
    if is_list and not (value or or_empty or isinstance(value, Mapping)):
        raise ParameterError(f"{said}: it should have an item or more, each {choices}")
    for item in value if is_list else [value]:
        if item not in allowed and not (callable(item) and callable in allowed):
            raise ParameterError(f"{said}: {item!r} should be {choices}{_hint(item, allowed)}")
    for key, item in value.items() if by_key else ():
        _check(key, item, allowed[key])


def _hint(item: Any, allowed: Any) -> str:
    """Ask whether another word was meant, if there is one like it."""
    if not isinstance(item, str) or isinstance(allowed, Interval):
        return ""
    near = get_close_matches(item, [word for word in allowed if isinstance(word, str)], 1)
    return f"; did you mean {near[0]!r}?" if near else ""


def sliders(draw: Callable[..., None], **ranges: tuple[float, float, float]) -> None:
    """Draw a picture, and below it, by hand in JupyterLab, the same with a slider for each argument.

    A range holds an argument's first value and its ends. The picture that is drawn without sliders
    stays in the saved notebook.
    """
    draw(**{name: first for name, (first, _, _) in ranges.items()})
    if "REPLICATION_OUT" in os.environ or not find_spec("ipywidgets"):
        return
    from ipywidgets import FloatSlider, interact

    made = {
        name: FloatSlider(
            first, min=low, max=high, step=(high - low) / 100, continuous_update=False
        )
        for name, (first, low, high) in ranges.items()
    }
    interact(draw, **made)
