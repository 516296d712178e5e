"""The workbook: runs the notebooks, keeps what they export, and turns it into verdicts and a report."""

from replication.files import QUICK, ROOT
from replication.workbook.outcomes import record_verdicts, save_figure, save_table, sliders

__all__ = ["QUICK", "ROOT", "record_verdicts", "save_figure", "save_table", "sliders"]
