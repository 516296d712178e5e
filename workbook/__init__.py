"""The workbook: runs the notebooks, keeps what they export, and turns it into verdicts and a report."""

from replication.files import ROOT
from workbook.checkout import QUICK
from workbook.outcomes import Interval, check_parameters, export, judge, sliders

__all__ = ["QUICK", "ROOT", "Interval", "check_parameters", "export", "judge", "sliders"]
