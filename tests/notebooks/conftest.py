import io

import IPython.display
import jupytext
import matplotlib
import pytest

import workbook
from replication.records import ROOT


@pytest.fixture
def run_notebook(monkeypatch):
    """Run a notebook's cells in this process with other parameters; returns its names, verdict and what it printed."""

    def run(name, **parameters):
        matplotlib.use("Agg")
        monkeypatch.setenv("BACKLASH_RECORDS", "simulated")
        verdicts, printed = [], io.StringIO()
        names = {
            "display": lambda *shown: None,
            "print": lambda *text, **how: print(*text, **how, file=printed),
        }
        monkeypatch.setattr(workbook, "verdict", lambda text, *_, **__: verdicts.append(text))
        monkeypatch.setattr(IPython.display, "display", lambda *shown: None)
        monkeypatch.setattr(workbook, "flipbook", lambda *drawn, **options: None)
        (source,) = (ROOT / "notebooks").glob(f"**/{name}*.py")
        for cell in jupytext.read(source).cells:
            if cell.cell_type == "code":
                exec(cell.source, names)
            if "parameters" in cell.metadata.get("tags", []):
                assert set(parameters) <= set(names), "no such parameter"
                names |= parameters
        return names, verdicts[0], printed.getvalue()

    return run
