"""The workbook: runs the notebooks, compares what they export with the printed numbers, makes report and book."""

import pandas as pd

from replication.records import ROOT
from workbook.animation import flipbook
from workbook.judging import judge, verdict
from workbook.outcomes import say, show, show_figure
from workbook.parameters import ParameterError, check_parameters, explain
from workbook.teaching import Change, check_answer, say_times, try_changing

# What notebooks call.
__all__ = [
    "ROOT",
    "Change",
    "ParameterError",
    "check_answer",
    "check_parameters",
    "explain",
    "flipbook",
    "judge",
    "say",
    "say_times",
    "show",
    "show_figure",
    "try_changing",
    "verdict",
]

# Notebooks show tables in full.
pd.set_option("display.max_colwidth", None, "display.max_columns", None, "display.max_rows", 200)
