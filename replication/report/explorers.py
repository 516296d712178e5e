"""Pages that a reader can play with: the signature over a record of our own simulator."""

from pathlib import Path

import pandas as pd

from replication import published
from replication.report import TEMPLATES
from replication.table2 import AUTHORS

# Name, symbol, unit and ends of each slider.
SLIDERS = (
    ("A", "A", "rps", -1.5, 1.5),
    ("t0", "t<sub>0</sub>", "s", -0.2, 0.6),
    ("tau", "τ", "1/s", 5.0, 30.0),
    ("omega", "ω", "rad/s", 6.3, 251.3),
    ("T1", "T<sub>1</sub>", "s", 0.0, 0.102),
    ("T2", "T<sub>2</sub>", "s", 0.0, 0.204),
    ("T_f", "T<sub>f</sub>", "s", 0.392, 0.412),
)


def render_signature_explorer(results: Path) -> str:
    """Render the page with the log of notebook 0 and the signature fitted to it; empty if they are not there."""
    log, fit = results / "start_log.csv", results / "start_fit.csv"
    if not (log.exists() and fit.exists()):
        return ""
    record, fitted = pd.read_csv(log), pd.read_csv(fit).iloc[0].to_dict()
    return TEMPLATES.get_template("signature.html.j2").render(
        record=record["speed_rps"].tolist(),
        dt=round(float(record["time_s"].iloc[-1]) / (len(record) - 1), 9),
        fitted=fitted,
        protocol=AUTHORS,
        printed_T_f=published.value("table1.T_f.max"),
        sliders=[(*slider, fitted[slider[0]]) for slider in SLIDERS],
    )
