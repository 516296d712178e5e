"""Sliders for who runs a notebook by hand; the executed copy shows the picture at the first values."""

import os
from collections.abc import Callable
from importlib.util import find_spec


def sliders(draw: Callable[..., None], **ranges: tuple[float, float, float]) -> None:
    """Draw a picture with a slider for each of its arguments.

    Without `ipywidgets` (in the extra `lab`), or in a run that makes the results, the picture is drawn once.
    """
    if "REPLICATION_OUT" in os.environ or not find_spec("ipywidgets"):
        draw(**{name: first for name, (first, _, _) in ranges.items()})
        return
    from ipywidgets import FloatSlider, interact

    interact(
        draw,
        **{
            name: FloatSlider(first, min=low, max=high, step=(high - low) / 100, continuous_update=False)
            for name, (first, low, high) in ranges.items()
        },
    )
