"""The workbook: runs the notebooks, keeps what they export, and turns it into verdicts and a report."""

from replication.workbook.files import QUICK, ROOT
from replication.workbook.interactive import sliders
from replication.workbook.outcomes import is_quick, save_figure, save_table, verdict

__all__ = ["QUICK", "ROOT", "is_quick", "save_figure", "save_table", "sliders", "verdict"]
