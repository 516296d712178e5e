"""The workbook: runs the notebooks, keeps what they export, and turns it into verdicts and a report."""

import sys
from importlib import import_module
from typing import Any

from replication.files import ROOT
from workbook.checkout import QUICK

# A library of nbformat's builds a grammar of addresses, which no notebook is checked for, in 2 s of every start.
_modules: dict[str, Any] = sys.modules
_modules.setdefault("rfc3987_syntax", None)

# What notebooks call, by its module: loaded when first named, because a command needs little of it.
_HOMES = {
    "Interval": "parameters",
    "check_parameters": "parameters",
    "export": "changes",
    "judge": "judging",
    "plain_animation": "report.animation",
    "show_figure": "outcomes",
    "sliders": "parameters",
    "verdict": "changes",
}
__all__ = ["QUICK", "ROOT", *_HOMES]


def __getattr__(name: str):
    """One of `_HOMES`."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"workbook.{_HOMES[name]}"), name)
