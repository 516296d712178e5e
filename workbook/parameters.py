"""A notebook's parameters: what they may be, and pictures that they move."""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pandas as pd

from replication.files import UserError

# Every notebook checks its parameters before it shows a table: tables in full.
pd.set_option("display.max_colwidth", None, "display.max_columns", None, "display.max_rows", 200)


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


# What `check_parameters` was asked about, by name.
checked: dict[str, Any] = {}


def check_parameters(**parameters: tuple[Any, Any]) -> None:
    """Refuse in one sentence a value that is not allowed; of a list each item, of a mapping each key.

    Each parameter comes with its value and what is allowed: an `Interval` or a collection, which may
    hold `callable` for any function. A list of one of these asks for a list; an empty list beside it
    says that none is allowed, too. A mapping says for each key which values it may have.
    """
    for name, (value, allowed) in parameters.items():
        checked[name] = value
        if isinstance(allowed, Mapping):
            check_parameters(**{name: (value, [tuple(allowed)])})
            check_parameters(**{key: (item, allowed[key]) for key, item in value.items()})
            checked[name] = value
            continue
        if is_list := isinstance(allowed, list):
            allowed = allowed[0]
        if isinstance(allowed, range) and len(allowed) > 20:
            allowed = Interval(allowed[0], allowed[-1], whole=True)
        choices = str(allowed)
        if not isinstance(allowed, Interval):
            choices = "one of " + ", ".join(map(repr, allowed))
            choices = choices.replace(repr(callable), "a function")
        if is_list != isinstance(value, list | tuple | range | Mapping):
            wanted = f"a list, each item {choices}" if is_list else choices
            raise ParameterError(f"{name} = {value!r}: it should be {wanted}")
        wrong = [
            item
            for item in (value if is_list else [value])
            if item not in allowed and not (callable(item) and callable in allowed)
        ]
        if wrong:
            raise ParameterError(f"{name} = {value!r}: {wrong[0]!r} should be {choices}")


def changed_parameters(source: Path) -> dict[str, tuple[Any, Any]]:
    """Parameters that are not those of a notebook's source: their value here and there."""
    cell = source.read_text("utf-8").partition('tags=["parameters"]\n')[2].partition("\n# %%")[0]
    there: dict[str, Any] = {}
    exec(cell, there)
    return {
        name: (value, there[name])
        for name, value in checked.items()
        if name in there and not callable(value) and value != there[name]
    }


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
