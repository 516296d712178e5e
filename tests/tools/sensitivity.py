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
from types import ModuleType

import numpy as np
import pandas as pd
from tqdm import tqdm

import workbook
from replication import characteristic, files, published, recording, search, statistics, table2
from replication.authors import (
    WORKBOOK_FILES,
    DataCorrupt,
    DataUnavailable,
    authors_file,
    level_delta_rad,
)
from replication.identify import Protocol
from replication.signature import FREE_PARAMETERS
from replication.simulator.parameters import identified_joint
from workbook.execution import NotebookFailed, execute

# Where a constant is tried: the cheap notebooks that use it, with the parameters that make them cheap.
SEARCH = {
    "05_signature_figure6": {},
    "07_protocol_table1": {"repeats": 1, "rows": [1], "variants": ["authors' notebook"]},
}
RECORDS = {"05_signature_figure6": {}, "03_simulator_figure10": {}}
SIMULATION = {"03_simulator_figure10": {}, "06_characteristic_figure12": {}}
EQUATION_10 = {"06_characteristic_figure12": {}}
NOWHERE: Mapping = {}
CHOICES = {"name", "start", "start_s", "rpm", "engine"}  # of the protocol: another candidate

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
    "tests/replay/test_replay.py::test_every_stored_generation_up_to_the_twentieth_replays",
    "tests/test_search.py",
    "tests/test_statistics.py",
    "tests/test_table2.py::test_misfits_within_two_thousandths_are_one_basin",
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
    """Every constant, changed: a continuous one by 5 %, a whole number by 1, what is 0 by 5 % of its scale."""
    first, step = level_delta_rad(2), level_delta_rad(3) - level_delta_rad(2)
    levels = "from replication import authors\nauthors.level_delta_rad = lambda level: {} + {} * (level - 2)"
    sampling = (
        "from replication.simulator import recordings\n"
        "recordings.simulate_recordings.__defaults__ = ({}, 12)"
    )
    printed = "from replication import published\npublished._cells().loc[{!r}, 'value'] = {{}}"
    found = [
        _change("first level", first, levels.format("{}", step), EQUATION_10),
        _change("level step", step, levels.format(first, "{}"), EQUATION_10),
        _change("sampling period", 0.002, sampling, SIMULATION),
        _module(characteristic, "RPM_PER_RPS", EQUATION_10),
        _module(recording, "TURN_PERIOD_S", RECORDS),
        _module(recording, "COMMANDED_SPEED_RPS", RECORDS),
        _module(statistics, "LEVEL"),
        _module(table2, "BASIN_GAP"),
        _module(search, "TOLFUN"),
        _module(search, "TOLFUNHIST"),
    ]
    for cell in ("text.encoder_bits", *(f"equation10.A{k}" for k in range(4))):
        value = published.value(cell)
        whole = int(value) if value.is_integer() else value
        found.append(_change(cell, whole, printed.format(cell), EQUATION_10))
    return found + _of_search() + _of_protocol() + _of_joint()


def _stepped(value: object) -> object:
    """What a constant is changed to; a share, which cannot grow beyond 1, is lowered."""
    if isinstance(value, tuple):
        return tuple(_stepped(each) for each in value)
    if isinstance(value, int):
        return value + 1
    return float(f"{(0.95 if 0.95 <= value < 1 else 1.05) * value:.6g}")


def _change(
    name: str, value: object, code: str, notebooks: Mapping = NOWHERE, to: object = None
) -> Change:
    """A constant that `code` sets, with braces where its value stands."""
    to = _stepped(value) if to is None else to
    shown = [f"{each:g}" if isinstance(each, float) else str(each) for each in (value, to)]
    return Change(name, *shown, code.format(to), notebooks)


def _module(module: ModuleType, name: str, notebooks: Mapping = NOWHERE) -> Change:
    # What is compiled into other functions is compiled anew, and not kept for others.
    fresh = "import os, tempfile\nos.environ['NUMBA_CACHE_DIR'] = tempfile.mkdtemp()\n"
    code = f"import {module.__name__} as module\nmodule.{name} = {{}}"
    return _change(name, getattr(module, name), fresh * (module is search) + code, notebooks)


def _of_search() -> list[Change]:
    """The constants of equations 13 to 17."""
    usual = search.constants(Protocol().population, len(FREE_PARAMETERS))._asdict()
    code = (
        "from replication import search\nusual = search.constants\n"
        "def constants(*sizes):\n    made = usual(*sizes)\n"
        "    return made._replace({0}=made.{0} * {{}} / {1})\n"
        "search.constants = constants"
    )
    names = ("mu_eff", "chi_n", "c_sigma", "d_sigma", "c_c", "c_1", "c_mu")
    return [
        _change(f"search, {name}", usual[name], code.format(name, usual[name]), SEARCH)
        for name in names
    ]


def _of_protocol() -> list[Change]:
    usual = {field.name: field.default for field in fields(Protocol)}
    code = "from replication.identify import Protocol\nProtocol.__init__.__defaults__ = {}"

    def defaults(name: str) -> tuple:
        return tuple((usual | {name: _stepped(usual[name])}).values())

    return [
        _change(f"protocol, {name}", usual[name], code.format(defaults(name)), SEARCH)
        for name in usual
        if name not in CHOICES
    ]


# What is 0 becomes 5 % of critical damping, of gravity's torque; the lead is a whole number of the drive's periods.
JOINT = dict.fromkeys(("gear_ratio", "load_mass_kg", "commanded_speed_rps", "alpha_per_rad"))
JOINT |= {"control_delay_periods": None, "control_period_s": 0.0455 / 87, "lead_s": 0.046}
JOINT |= {"damping_nms_per_rad": 9.1, "load_coulomb_nm": 0.71}


def _of_joint() -> list[Change]:
    joint = identified_joint()
    code = (
        "from replication.simulator import parameters\nold = parameters.identified_joint()\n"
        "new = parameters.{}\nparameters.identified_joint = lambda: new"
    )
    ratio, other = (
        code.format("with_ratios(old, dict({}={{}}))"),
        code.format("replace(old, {}={{}})"),
    )
    values = {name: getattr(joint, name) for name in JOINT} | joint.ratios
    return [
        _change(
            f"joint, {name}",
            value,
            (ratio if name in joint.ratios else other).format(name),
            SIMULATION,
            JOINT.get(name),
        )
        for name, value in values.items()
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
    whole = (workbook.ROOT / "notebooks" / f"{name}.py").read_text("utf-8")
    head, cell, rest = SOLUTION.sub("", whole).partition("\n# %%")
    source = folder / f"{name}.py"
    folder.mkdir(exist_ok=True)
    source.write_text(f"{head}\n# %%\n{code or 'pass'}\n{cell}{rest}{_JUDGE}", "utf-8")
    try:
        execute(source, quick=True, destination=folder, parameters=values)
    except NotebookFailed:
        if not code:
            raise
        return {}
    cells = pd.read_csv(folder / "results" / _JUDGED)
    claims = json.loads((folder / "results" / "outcomes" / f"{name}.json").read_text("utf-8"))[
        "claims"
    ]
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
            agreed = verdict in ("reproduced", "traced", "consistent")
            noticed = agreed and (moved or verdict_now != verdict)
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
    """What the report shows: a row for each constant with how many of each group move, and how many are missing."""
    rows = []
    for _, part in table.groupby("constant", sort=False):
        noticed = part[part["group"] != ""]
        moved = noticed.dropna(subset="after")
        about = part.iloc[0][["constant", "value", "changed"]].to_dict()
        examples = ", ".join(moved.drop_duplicates("group")["id"]) or "nothing"
        counts = moved["group"].value_counts().to_dict()
        missing = len(noticed) - len(moved)
        rows.append(about | {"counts": counts, "missing": missing, "examples": examples})
    groups = set(table["group"]) - {""}
    columns = sorted(groups, key=lambda name: (KINDS.index(name.split()[0]), name))
    return {"rows": rows, "columns": columns}


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
