"""The workbook: runs the notebooks, keeps what they export, and turns it into verdicts and a report."""

import sys
from typing import Any

from replication.files import ROOT
from workbook.animation import plain_animation
from workbook.changes import export, judge, verdict
from workbook.outcomes import show_figure
from workbook.parameters import Interval, check_parameters, sliders

# What notebooks call.
__all__ = [
    "ROOT",
    "Interval",
    "check_parameters",
    "export",
    "judge",
    "plain_animation",
    "show_figure",
    "sliders",
    "verdict",
]

# A library of nbformat's builds a grammar of addresses, which no notebook is checked for, in 2 s of every start.
_modules: dict[str, Any] = sys.modules
_modules.setdefault("rfc3987_syntax", None)
