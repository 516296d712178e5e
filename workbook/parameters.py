"""A notebook's parameters: what they may be, and pictures that they move."""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import pandas as pd

# Every notebook checks its parameters before it shows a table: tables in full.
pd.set_option("display.max_colwidth", None, "display.max_columns", None, "display.max_rows", 200)


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


def check_parameters(**parameters: tuple[Any, Any]) -> None:
    """Refuse in one sentence a value that is not allowed; of a list each item, of a mapping each key.

    Each parameter comes with its value and what is allowed: an `Interval` or a collection. A list of
    one of these asks for a list.
    """
    for name, (value, allowed) in parameters.items():
        if is_list := isinstance(allowed, list):
            (allowed,) = allowed
        if isinstance(allowed, range) and len(allowed) > 20:
            allowed = Interval(allowed[0], allowed[-1], whole=True)
        choices = str(allowed)
        if not isinstance(allowed, Interval):
            choices = "one of " + ", ".join(map(repr, allowed))
        if is_list != isinstance(value, list | tuple | range | Mapping):
            wanted = f"a list, each item {choices}" if is_list else choices
            raise ValueError(f"{name} = {value!r}: it should be {wanted}")
        wrong = [item for item in (value if is_list else [value]) if item not in allowed]
        if wrong:
            raise ValueError(f"{name} = {value!r}: {wrong[0]!r} should be {choices}")


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
