"""The workbook: runs the notebooks, keeps what they export, and turns it into verdicts and a report."""

import pandas as pd

from replication.files import ROOT
from workbook.animation import plain_animation
from workbook.checkout import QUICK
from workbook.judging import judge
from workbook.outcomes import export
from workbook.parameters import Interval, check_parameters, sliders

__all__ = [
    "QUICK",
    "ROOT",
    "Interval",
    "check_parameters",
    "export",
    "judge",
    "plain_animation",
    "sliders",
]

# Tables in full.
pd.set_option("display.max_colwidth", None, "display.max_columns", None, "display.max_rows", 200)
