"""Mutation test of constants: which cells, claims and tests notice a wrong one (`make studies NAME=sensitivity`).

Each constant is changed alone, before anything else is imported, in the notebooks and the tests themselves.
"""

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

import workbook
from replication import characteristic, files, published
from replication.authors import (
    WORKBOOK_FILES,
    DataCorrupt,
    DataUnavailable,
    authors_file,
    level_delta_rad,
)
from replication.identify import Protocol
from replication.recording import COMMANDED_SPEED_RPS, TURN_PERIOD_S
from replication.simulator.parameters import identified_joint
from workbook.execution import NotebookFailed, execute

# Where a constant is tried: the cheap notebooks that use it, with the parameters that make them cheap.
SEARCH = {
    "01_signature_figure6": {},
    "07_protocol_table1": {"repeats": 1, "rows": [1], "variants": ["authors' notebook"]},
}
RECORDS = {"01_signature_figure6": {}, "04_simulator_figure10": {}}
SIMULATION = {"04_simulator_figure10": {}, "06_characteristic_figure12": {}}
EQUATION_10 = {"06_characteristic_figure12": {}}

# The tests that are tried with every constant: those of the committed code that take seconds.
TESTS = (
    "tests/test_characteristic.py",
    "tests/test_recording.py::test_the_turn_period_in_the_data_is_400_ms",
    "tests/test_identify.py::test_a_drawn_start_lies_among_the_first_samples_that_the_paper_names",
    "tests/test_identify.py::test_every_stored_seed_gives_its_stored_first_generation",
    "tests/test_results.py::test_the_runs_of_table_2_spent_what_the_protocol_allows",
    "tests/test_signature.py::test_the_signature_at_the_stored_parameters_has_the_stored_misfit",
    "tests/test_signature.py::test_the_box_is_table_1",
    "tests/simulator/test_identified_joint.py",
)

SOLUTION = re.compile(
    r'\n# %% tags=\["solution"\]\n.*?(?=\n# %%|\Z)', re.DOTALL
)  # asserts more than the paper says
KINDS = (
    "Table",
    "Equation",
    "Figure",
    "Text",
    "claims",
    "tests",
)  # the order of the report's columns
RESULTS = workbook.ROOT / "results"
_JUDGED = "judged.csv"
# Judged in the notebook's own kernel, where the changed constant is.
_JUDGE = f"""
# %%
import pandas as pd
from workbook import judging, outcomes

results = outcomes.output_folder() / "results"
cells = pd.DataFrame(outcomes.load_outcomes(results)[outcomes.notebook_name()]["cells"]).assign(notebook="")
judged = judging.judge_rows(cells) if len(cells) else pd.DataFrame(columns=["id", "source", "reproduced", "verdict"])
judged.to_csv(results / "{_JUDGED}")
"""

# By kind ("cell", "claim", "test"), id and source: the value and verdict of a cell, whether a claim or a test holds.
Found = dict[tuple[str, str, str], tuple[float, str]]


@dataclass(frozen=True)
class Change:
    """One constant changed: its name, both values as text, the code that changes it, the notebooks that use it."""

    constant: str
    value: str
    changed: str
    code: str
    notebooks: Mapping[str, Mapping[str, object]]


def changes() -> list[Change]:
    """Every constant, changed: coefficients and ratios by 5 %, what is whole or a multiple by a step."""
    first, step = level_delta_rad(2), level_delta_rad(3) - level_delta_rad(2)
    levels = "from replication import authors\nauthors.level_delta_rad = lambda level: {} + {} * (level - 2)"
    noise = (
        "from replication import recording\nadd = recording.add_uniform_noise\n"
        "recording.add_uniform_noise = lambda record, half, rng: add(record, 1.05 * half, rng)"
    )
    sampling = (
        "from replication.simulator import recordings\n"
        "recordings.simulate_recordings.__defaults__ = (0.0021, 12)"
    )
    found = [
        _module("characteristic", "RPM_PER_RPS", characteristic.RPM_PER_RPS, 63.0, EQUATION_10),
        Change(
            "first level",
            f"{first:g}",
            f"{1.2 * first:g}",
            levels.format(1.2 * first, step),
            EQUATION_10,
        ),
        Change(
            "level step",
            f"{step:g}",
            f"{1.05 * step:g}",
            levels.format(first, 1.05 * step),
            EQUATION_10,
        ),
        Change("noise factor", "1", "1.05", noise, {}),
        Change("sampling period", "0.002", "0.0021", sampling, SIMULATION),
        _module("recording", "TURN_PERIOD_S", TURN_PERIOD_S, 0.408, RECORDS),
        _module("recording", "COMMANDED_SPEED_RPS", COMMANDED_SPEED_RPS, 101.0, RECORDS),
        _printed("text.encoder_bits", published.value("text.encoder_bits") - 1),
    ]
    found += [
        _printed(cell, 1.05 * published.value(cell))
        for cell in (f"equation10.A{k}" for k in range(4))
    ]
    return found + _of_protocol() + _of_joint()


def _module(module: str, name: str, value: float, changed: float, notebooks: Mapping) -> Change:
    code = f"from replication import {module}\n{module}.{name} = {changed}"
    return Change(name, f"{value:g}", f"{changed:g}", code, notebooks)


def _printed(cell: str, changed: float) -> Change:
    code = (
        f"from replication import published\npublished._cells().loc[{cell!r}, 'value'] = {changed}"
    )
    return Change(cell, f"{published.value(cell):g}", f"{changed:g}", code, EQUATION_10)


PROTOCOL = {
    "T_d": 0.19,
    "T_f": published.value("table1.T_f.max"),
    "turns": 11,
    "population": 310,
    "iterations": 210,
    "amplitude_factor": 1.2,
    "longest_window_s": 0.214,
    "damping_per_s": (6.0, 30.0),
    "frequency_hz": (1.0, 42.0),
    "latest_start": 105,
    "engine": "cma",
}


def _of_protocol() -> list[Change]:
    usual = {field.name: field.default for field in fields(Protocol)}
    code = "from replication.identify import Protocol\nProtocol.__init__.__defaults__ = {}"

    def changed(name: str, value: object) -> Change:
        defaults = tuple((usual | {name: value}).values())
        return Change(
            f"protocol, {name}", str(usual[name]), str(value), code.format(defaults), SEARCH
        )

    return [changed(name, value) for name, value in PROTOCOL.items()]


JOINT = {
    "gear_ratio": 41.0,
    "load_mass_kg": 5.6,
    "commanded_speed_rps": 101.0,
    "control_period_s": 3.5e-4,
    "control_delay_periods": 2,
    "alpha_per_rad": 1e5,
    "damping_nms_per_rad": 1.0,
    "load_coulomb_nm": 0.1,
}


def _of_joint() -> list[Change]:
    joint = identified_joint()
    code = "from replication.simulator import parameters\njoint = {}\nparameters.identified_joint = lambda: joint"
    ratios = {
        name: value + joint.control_period_s if name == "lead_s" else 0.95 * value
        for name, value in joint.ratios.items()
    }

    def changed(name: str, value: float, new: float, joint_code: str) -> Change:
        return Change(
            f"joint, {name}", f"{value:g}", f"{new:g}", code.format(joint_code), SIMULATION
        )

    as_it_is = "parameters.identified_joint()"
    found = [
        changed(
            name,
            joint.ratios[name],
            value,
            f"parameters.with_ratios({as_it_is}, {{{name!r}: {value}}})",
        )
        for name, value in ratios.items()
    ]
    return found + [
        changed(
            name, getattr(joint, name), value, f"parameters.replace({as_it_is}, {name}={value})"
        )
        for name, value in JOINT.items()
    ]


# ---------------------------------------------------------------------------------------------------------------
# What notebooks and tests find


def found_by(change: Change, folder: Path) -> dict[str, Found]:
    """Run the tests and the change's notebooks with it; what a notebook that fails would have found is missing."""
    notebooks = {
        name: _executed(name, values, change.code, folder)
        for name, values in change.notebooks.items()
    }
    return {"tests": _tested(change.code)} | notebooks


def _executed(name: str, values: Mapping[str, object], code: str, folder: Path) -> Found:
    whole = (workbook.ROOT / "notebooks" / f"{name}.py").read_text(encoding="utf-8")
    head, cell, rest = SOLUTION.sub("", whole).partition("\n# %%")
    source = folder / f"{name}.py"
    folder.mkdir(exist_ok=True)
    source.write_text(f"{head}\n# %%\n{code or 'pass'}\n{cell}{rest}{_JUDGE}", encoding="utf-8")
    try:
        execute(source, quick=True, destination=folder, parameters=values)
    except NotebookFailed:
        if not code:
            raise
        return {}
    cells = pd.read_csv(folder / "results" / _JUDGED)
    claims = json.loads(
        (folder / "results" / "outcomes" / f"{name}.json").read_text(encoding="utf-8")
    )["claims"]
    found = {
        ("cell", row["id"], row["source"]): (row["reproduced"], row["verdict"])
        for row in cells.to_dict("records")
    }
    return found | {
        ("claim", row["id"], ""): (float(row["holds"]), "")
        for row in claims
        if row["holds"] is not None
    }


def _tested(code: str) -> Found:
    script = f"{code}\nimport pytest\npytest.main(['-rA', '-p', 'no:cacheprovider', *{TESTS!r}])"
    run = subprocess.run(
        [sys.executable, "-c", script],
        cwd=workbook.ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    ended = [line.split(" - ")[0].split(maxsplit=1) for line in run.stdout.splitlines()]
    return {
        ("test", parts[1].partition("::")[2].partition("[")[0], ""): (
            float(parts[0] == "PASSED"),
            "",
        )
        for parts in sorted(ended, reverse=True)
        if len(parts) == 2 and parts[0] in ("PASSED", "FAILED", "ERROR")
    }


# ---------------------------------------------------------------------------------------------------------------
# Who notices


def group(kind: str, name: str) -> str:
    """Column of the matrix that a cell, claim or test belongs to."""
    if kind != "cell":
        return f"{kind}s"
    element, column = published.cells().loc[name, ["element", "column"]]
    if element != "Table 2":
        return str(element)
    return "Table 2, theoretical A" if column == "theoretical" else "Table 2, means and errors"


def noticing(before: Found, after: Found) -> list[tuple[tuple[str, str, str], float, float]]:
    """Agreeing cells, claims and tests whose verdict flips, or value moves by more than its tolerance or is missing."""
    is_bound = published.cells()["kind"] == "bound"
    hits = []
    for key, (value, verdict) in before.items():
        kind, name, _ = key
        now, verdict_now = after.get(key, (np.nan, ""))
        if kind == "cell":
            moved = not is_bound[name] and not abs(now - value) <= published.tolerance(name)
            noticed = verdict in ("reproduced", "consistent") and (moved or verdict_now != verdict)
        else:
            noticed = now != value
        if noticed:
            hits.append((key, value, now))
    return hits


def sensitivity(
    chosen: Sequence[Change] | None = None,
    notebooks: Mapping[str, Mapping[str, object]] = SEARCH | SIMULATION,
) -> pd.DataFrame:
    """Change each constant: a row for each cell, claim or test that notices it, one of an empty group if none does."""
    for path in WORKBOOK_FILES:
        authors_file(path)
    chosen = changes() if chosen is None else chosen
    with (
        tempfile.TemporaryDirectory(dir=workbook.ROOT, prefix=".staging-") as folder,
        ThreadPoolExecutor(2) as pool,
    ):
        every = [Change("", "", "", "", notebooks), *chosen]
        runs = pool.map(
            lambda numbered: found_by(numbered[1], Path(folder) / str(numbered[0])),
            enumerate(every),
        )
        before, *after = tqdm(runs, total=len(every), unit="constant")
    rows = []
    for change, found in zip(chosen, after, strict=True):
        head = {"constant": change.constant, "value": change.value, "changed": change.changed}
        hits = [hit for place, there in found.items() for hit in noticing(before[place], there)]
        rows += [
            head
            | {"group": group(kind, name), "kind": kind, "id": name, "source": source}
            | {"before": value, "after": now}
            for (kind, name, source), value, now in hits
        ]
        if not hits:
            rows.append(head | {"group": "", "kind": "", "id": "", "source": ""})
    return pd.DataFrame(rows)


def matrix(table: pd.DataFrame) -> dict[str, list]:
    """What the report shows: a row for each constant with how many of each group notice it, and the groups."""
    rows = []
    for _, part in table.groupby("constant", sort=False):
        noticed = part[part["group"] != ""]
        about = part.iloc[0][["constant", "value", "changed"]].to_dict()
        examples = ", ".join(noticed.drop_duplicates("group")["id"]) or "nothing"
        rows.append(
            about | {"counts": noticed["group"].value_counts().to_dict(), "examples": examples}
        )
    groups = set(table["group"]) - {""}
    return {
        "rows": rows,
        "columns": sorted(groups, key=lambda name: (KINDS.index(name.split()[0]), name)),
    }


def main() -> int:
    """Write `results/sensitivity.csv`, and what the report shows of it."""
    try:
        table = sensitivity()
    except (DataUnavailable, DataCorrupt) as error:
        print(error, file=sys.stderr)
        return 2
    files.write_csv(RESULTS / "sensitivity.csv", table)
    files.write_json(RESULTS / "pages" / "sensitivity.json", matrix(table))
    print(
        table.groupby(["constant", "changed"], sort=False)["group"]
        .agg(lambda g: (g != "").sum())
        .to_string()
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
