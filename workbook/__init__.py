"""The workbook: runs the notebooks, keeps what they export, and turns it into verdicts and a report."""

from importlib import import_module

from replication.files import ROOT
from workbook.checkout import QUICK

# What notebooks call, by its module: loaded when first named, because a command needs little of it.
_HOMES = {
    "Interval": "parameters",
    "check_parameters": "parameters",
    "export": "outcomes",
    "judge": "judging",
    "plain_animation": "animation",
    "sliders": "parameters",
}
__all__ = ["QUICK", "ROOT", *_HOMES]


def __getattr__(name: str):
    """One of `_HOMES`."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"workbook.{_HOMES[name]}"), name)
