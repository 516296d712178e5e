"""Pages that a reader can play with: the signature over a record of our own simulator, and the replayed runs."""

from pathlib import Path

import pandas as pd

from replication import published
from replication.replay import AGREE_RPS
from replication.table2 import AUTHORS_PROTOCOL, BASIN_GAP
from workbook.report import TEMPLATES

# Symbol and unit of each slider, and its ends where they are not those that Table 1 prints.
SLIDERS = {
    "A": ("A", "rps", -1.5, 1.5),
    "t0": ("t<sub>0</sub>", "s", -0.2, 0.6),
    "tau": ("τ", "1/s"),
    "omega": ("ω", "rad/s"),
    "T1": ("T<sub>1</sub>", "s"),
    "T2": ("T<sub>2</sub>", "s"),
    "T_f": ("T<sub>f</sub>", "s", 0.392, 0.412),
}


def render_signature_explorer(results: Path) -> str:
    """Render the page with the log of notebook 0 and the signature fitted to it; empty if they are not there."""
    log, fit = results / "start_log.csv", results / "start_fit.csv"
    if not (log.exists() and fit.exists()):
        return ""
    record, fitted = pd.read_csv(log), pd.read_csv(fit).iloc[0].to_dict()
    sliders = []
    for name, (symbol, unit, *ends) in SLIDERS.items():
        low, high = ends or (published.value(f"table1.{name}.{end}") for end in ("min", "max"))
        sliders.append((name, symbol, unit, low, high, fitted[name]))
    return TEMPLATES.get_template("signature.html.j2").render(
        record=record["speed_rps"].tolist(),
        dt=round(float(record["time_s"].iloc[-1]) / (len(record) - 1), 9),
        fitted=fitted,
        protocol=AUTHORS_PROTOCOL,
        printed_T_f=published.value("table1.T_f.max"),
        sliders=sliders,
    )


def render_replay_explorer(results: Path) -> str:
    """Render the page that plays the replayed runs of notebook 1; empty if its results are not there."""
    files = [results / f"{name}.csv" for name in ("replay_frames", "replay_box", "stored_runs", "stored_basins")]
    if not all(file.exists() for file in files):
        return ""
    frames, box, stored, basins = (pd.read_csv(file) for file in files)
    kept = frames.groupby("run")[["generation", "frame"]].agg(list)
    runs = published.authors_notebook_runs().merge(stored[["run", "basin"]]).merge(kept, on="run")
    generations = published.authors_notebook_generations()[["run", "generation", "best_rmse_of_generation_rps"]]
    return TEMPLATES.get_template("replay.html.j2").render(
        runs=runs.to_dict("records"),
        printed=generations.to_numpy().tolist(),
        box=box.to_dict("records"),
        basins=basins["rmse_rps"].tolist(),
        settings={"gap": BASIN_GAP, "agree": AGREE_RPS, "members": AUTHORS_PROTOCOL.population},
    )
