"""Tests with teeth: which cells, claims and tests notice when a constant of the model or the protocol is wrong.

Each constant is changed alone, and everything cheap that depends on it is computed again by the functions that the
notebooks call. Two things stand in for dear ones: the global fit for the mean of 30 CMA-ES runs, and the first
generation of each stored seed for the search itself. What every run spent is read from the committed runs.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pandas as pd

from replication import characteristic, decisions, inspection, published, table2, workbook
from replication import simulated as simulations
from replication.datasets import (
    COMMANDED_SPEED_RPS,
    TURN_PERIOD_S,
    Recording,
    add_uniform_noise,
    constant_speed,
    level_delta_rad,
    load_clean,
)
from replication.global_fit.fit import global_fit
from replication.identify import Protocol, first_generation_rmse
from replication.signature import rmse
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import DivergenceError, JointParameters, identified_joint, with_ratios
from replication.simulator.study import CLEAN_LEVELS, FIRST_TURN_BAR, clean_records, first_turn_nrmse, validate
from replication.workbook import judging

# By kind ("cell", "claim", "test"), id and source: a number for a cell, and whether it holds for the others.
Found = dict[tuple[str, str, str], float]

STORED_SEEDS = 5  # of the 30, whose first generation is drawn again


@dataclass(frozen=True)
class Setup:
    """Everything that may be changed: one field a constant, or a room of constants.

    Attributes
    ----------
    joint : JointParameters
        The simulated joint.
    protocol : Protocol
        The paper's search, with Table 1's box and the fixed periods.
    equation10 : tuple of float
        Coefficients from the constant upwards [1e-6 rad/rpm^k].
    rpm_per_rps : float
        What the tables' A is multiplied by.
    first_level_rad, level_step_rad : float
        Backlash of Table 2's first row, and from row to row [rad].
    noise_factor : float
        Half-amplitude of the made noise over the printed one.
    sample_s : float
        Sampling of simulated records [s].
    turn_period_s, commanded_speed_rps : float
        What the authors' records are taken for.
    encoder_bits : float
        Resolution of the encoder.
    """

    joint: JointParameters
    equation10: tuple[float, ...]
    encoder_bits: float
    protocol: Protocol = table2.AUTHORS
    rpm_per_rps: float = characteristic.RPM_PER_RPS
    first_level_rad: float = level_delta_rad(2)
    level_step_rad: float = level_delta_rad(3) - level_delta_rad(2)
    noise_factor: float = 1.0
    sample_s: float = 2e-3
    turn_period_s: float = TURN_PERIOD_S
    commanded_speed_rps: float = COMMANDED_SPEED_RPS

    @property
    def levels_rad(self) -> tuple[float, ...]:
        """Backlash of Table 2's ten rows [rad]."""
        return tuple(self.first_level_rad + self.level_step_rad * np.arange(len(table2.table2_levels())))


@dataclass(frozen=True)
class Change:
    """One constant changed: its name, its value and the changed one as text, and the setup with it."""

    constant: str
    value: str
    changed: str
    setup: Setup


def nominal() -> Setup:
    """Return the setup that the results were made with."""
    coefficients = tuple(published.value(f"equation10.A{k}") for k in range(4))
    return Setup(identified_joint(), coefficients, published.value("text.encoder_bits"))


# ---------------------------------------------------------------------------------------------------------------
# The constants


def changes(base: Setup) -> list[Change]:
    """Every constant, changed by the amount stated.

    Coefficients and ratios by 5 %; what has to be whole, or a multiple of something, by a step of it.
    """
    found = [_of(base, name, getattr(base, name), factor * getattr(base, name)) for name, factor in _SETUP.items()]
    found.append(_of(base, "encoder_bits", base.encoder_bits, base.encoder_bits - 1))
    for power, value in enumerate(base.equation10):
        coefficients = tuple(1.05 * v if k == power else v for k, v in enumerate(base.equation10))
        setup = replace(base, equation10=coefficients)
        found.append(Change(f"equation 10, A^{power}", f"{value:g}", f"{1.05 * value:g}", setup))
    periods = replace(base.protocol, T_d=published.value("table1.T_d.max"), T_f=published.value("table1.T_f.max"))
    value, changed = (f"{p.T_d:g} and {p.T_f:g}" for p in (base.protocol, periods))
    found.append(Change("protocol, T_d and T_f", value, changed, replace(base, protocol=periods)))
    for name, value in _PROTOCOL.items():
        setup = replace(base, protocol=replace(base.protocol, **{name: value}))
        found.append(Change(f"protocol, {name}", _text(getattr(base.protocol, name)), _text(value), setup))
    for name, value in base.joint.ratios.items():
        changed = value + base.joint.control_period_s if name == "lead_s" else 0.95 * value
        setup = replace(base, joint=with_ratios(base.joint, {name: changed}))
        found.append(Change(f"joint, {name}", f"{value:g}", f"{changed:g}", setup))
    for name, value in _JOINT.items():
        setup = replace(base, joint=replace(base.joint, **{name: value}))
        found.append(Change(f"joint, {name}", f"{getattr(base.joint, name):g}", f"{value:g}", setup))
    return found


_SETUP = {
    "rpm_per_rps": 1.05,
    "first_level_rad": 1.2,
    "level_step_rad": 1.05,
    "noise_factor": 1.05,
    "sample_s": 1.05,
    "turn_period_s": 1.02,
    "commanded_speed_rps": 1.01,
}

_PROTOCOL = {
    "T_d": 0.19,
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

_JOINT = {
    "gear_ratio": 41.0,
    "load_mass_kg": 5.6,
    "commanded_speed_rps": 101.0,
    "control_period_s": 3.5e-4,
    "control_delay_periods": 2,
    "alpha_per_rad": 1e5,
    "damping_nms_per_rad": 1.0,
    "load_coulomb_nm": 0.1,
}


def _of(base: Setup, name: str, value: float, changed: float) -> Change:
    return Change(name, f"{value:g}", f"{changed:g}", replace(base, **{name: changed}))


def _text(value: object) -> str:
    if isinstance(value, str):
        return value
    return " to ".join(f"{v:g}" for v in value) if isinstance(value, tuple) else f"{value:g}"


# ---------------------------------------------------------------------------------------------------------------
# What is computed again; each part is kept for the changes that do not touch it


def found(setup: Setup) -> Found:
    """Compute every cheap cell, claim and test with a setup; without those that a part of the program refuses."""
    s = setup
    parts = (
        (_of_record, (s.protocol, s.turn_period_s, s.commanded_speed_rps)),
        (_of_equation10, (s.equation10, s.rpm_per_rps, s.levels_rad, s.encoder_bits)),
        (_of_joint, (s.joint, s.levels_rad, s.sample_s)),
        (_of_fits, (s.protocol,)),
        (_of_simulated_fits, (s.joint, s.levels_rad, s.noise_factor, s.sample_s, s.protocol)),
        (_of_protocol, (s.protocol,)),
    )
    results: Found = {}
    for compute, arguments in parts:
        with suppress(ValueError, DivergenceError):
            results |= compute(*arguments)
    return results


def _cells(values: dict[str, float], source: str) -> Found:
    return {("cell", cell, source): float(value) for cell, value in values.items()}


def _claims(decided: dict[str, decisions.Decision]) -> Found:
    return {("claim", claim, ""): float(holds) for claim, (holds, _) in decided.items()}


def _tests(**outcomes: bool) -> Found:
    return {("test", f"test_{name}", ""): float(passed) for name, passed in outcomes.items()}


@cache
def _record12() -> Recording:
    return load_clean(12)


@cache
def _authors_records() -> list[tuple[dict, Recording]]:
    return table2.authors_table2_records([1])


@cache
def _clean_records() -> dict[float, Recording]:
    return clean_records(CLEAN_LEVELS)


@cache
def _of_record(protocol: Protocol, turn_period_s: float, commanded_speed_rps: float) -> Found:
    """Notebooks 1 and 7: the box of a clean record, its turns and its impacts."""
    record = replace(_record12(), turn_period_s=turn_period_s, commanded_speed_rps=commanded_speed_rps)
    cells = inspection.table1_cells(record, protocol).to_dict()
    cells |= {"text.turns": inspection.whole_turns(record), "text.latest_start": protocol.latest_start}
    tests = _tests(the_turn_period_in_the_data_is_0_4_s=abs(inspection.turn_period(record) - turn_period_s) < 0.0005)
    return _cells(cells, "authors") | _claims(decisions.impacts(record)) | tests


@cache
def _of_equation10(
    coefficients: tuple[float, ...], rpm_per_rps: float, levels_rad: tuple[float, ...], bits: float
) -> Found:
    """Notebook 6: the cubic through the printed points, and the printed means through equation 10."""
    printed = published.column("Table 2", "theoretical")[: len(levels_rad)]
    scale = rpm_per_rps / characteristic.RPM_PER_RPS
    fitted = characteristic.fit_characteristic(scale * printed, np.array(levels_rad))
    cells = decisions.equation10_cells(fitted)
    for power, coefficient in enumerate(coefficients):
        # A wrong coefficient is a wrong printed number: what counts is its distance from the fitted one.
        cell = f"equation10.A{power}"
        cells[cell] += published.value(cell) - coefficient
    equation = characteristic.Characteristic(1e-6 * np.array(coefficients), np.nan)
    errors = decisions.errors_of_printed_means(equation)
    step, step_decision = decisions.encoder_step(bits)
    cells |= decisions.error_cells(errors) | {"text.encoder_step": step}
    cells |= {"text.delta_min": levels_rad[0], "text.delta_max": levels_rad[-1]}
    claims = decisions.characteristic(equation, errors) | {"encoder_step": step_decision}
    off = np.abs(equation.backlash_rad(scale * printed) - levels_rad).max()
    return _cells(cells, "authors") | _claims(claims) | _tests(equation_10_takes_rpm_not_rps=off < 2e-5)


@cache
def _of_joint(joint: JointParameters, levels_rad: tuple[float, ...], sample_s: float) -> Found:
    """Notebooks 3 to 6: the simulated joint against the clean records and the printed amplitudes."""
    peaks = simulations.amplitudes(joint, levels_rad)
    validation = validate(joint, _clean_records())
    rows = range(1, len(levels_rad) + 1)
    cells = {f"table2.row{row:02d}.theoretical": peak for row, peak in zip(rows, peaks["amplitude_rps"], strict=True)}
    cells |= decisions.equation10_cells(characteristic.fit_characteristic(peaks["amplitude_rps"], np.array(levels_rad)))
    cells |= {"text.delta_step": levels_rad[1] - levels_rad[0], "text.load": joint.load_mass_kg}
    claims = {
        "simulator_agrees": decisions.simulator_agrees(validation),
        "amplitude_grows": decisions.amplitude_grows(peaks),
    }
    within_bars = validation["nrmse"].max() < 0.03 and validation["peak_error_percent"].abs().max() < 1
    record, simulated = _record12(), simulate_recordings(joint, [level_delta_rad(12)], sample_s)[0]
    same_times = simulated.t.size == record.t.size and np.allclose(simulated.t, record.t, atol=1e-9)
    first_turn = first_turn_nrmse(joint, _clean_records())
    tests = _tests(
        the_first_turn_of_the_simulated_joint_is_that_of_the_records=first_turn.max() < FIRST_TURN_BAR,
        the_simulator_meets_its_bars_on_every_record_and_every_printed_peak=within_bars,
        a_simulated_record_has_the_time_stamps_of_the_authors=same_times,
    )
    return _cells(cells, "simulated") | _claims(claims) | tests


def _fitted(records: list[tuple[dict, Recording]], protocol: Protocol) -> pd.DataFrame:
    """Table 2's columns from the global fit of each record; the best basin and the mean are the same then."""
    printed = published.column("Table 2", "theoretical")
    rows = []
    for key, record in records:
        theory, amplitude = printed[key["row"] - 1], global_fit(record, protocol).amplitude_rps
        error = 100 * abs(amplitude - theory) / theory if theory > 0 else np.nan
        rows.append([key["row"], theory, amplitude, amplitude, error])
    names = ["row", "theoretical_A_rps", "mean_A_rps", "best_A_rps", "relative_error_percent"]
    return pd.DataFrame(rows, columns=names)


def _table2(table: pd.DataFrame, source: str) -> Found:
    cells = {}
    for row in table[table["theoretical_A_rps"] > 0].to_dict("records"):
        head = f"table2.row{int(row['row']):02d}"
        cells |= {f"{head}.mean": row["mean_A_rps"], f"{head}.relative_error": row["relative_error_percent"]}
    return _cells(cells, source)


@cache
def _of_fits(protocol: Protocol) -> Found:
    """Notebook 8 on the authors' records."""
    table = _fitted(_authors_records(), protocol)
    return _table2(table, "authors") | _claims({"error_below_10": decisions.error_below_10(table)})


@cache
def _of_simulated_fits(
    joint: JointParameters, levels_rad: tuple[float, ...], noise_factor: float, sample_s: float, protocol: Protocol
) -> Found:
    """Notebook 8 on our own records, and on pure noise."""
    printed = noise_factor * published.column("Table 2", "noise")
    rng = np.random.default_rng(1)
    clean = [*simulate_recordings(joint, levels_rad, sample_s), constant_speed(samples=2401, dt=0.002)]
    noisy = [add_uniform_noise(record, half, rng) for record, half in zip(clean, printed, strict=True)]
    table = _fitted([({"row": row}, record) for row, record in enumerate(noisy, start=1)], protocol)
    halves = np.array([np.ptp(loud.v - quiet.v) / 2 for loud, quiet in zip(noisy, clean, strict=True)])
    loud = np.abs(halves / published.column("Table 2", "noise") - 1).max() < 0.01
    amplitude = table["mean_A_rps"]
    claim = {"no_backlash": decisions.no_backlash(amplitude.iloc[-1], amplitude.iloc[0])}
    tests = _tests(the_made_noise_has_the_printed_half_amplitudes=loud)
    return _table2(table, "simulated") | _claims(claim) | tests


@cache
def _of_protocol(protocol: Protocol) -> Found:
    """Notebook 1 on the stored runs, and what the committed runs spent."""
    record, stored = _record12(), published.authors_notebook_runs()
    names = ("A_rps", "t0_s", "tau_per_s", "omega_rad_per_s", "c_rps", "window_end_s", "window_start_s")
    run = stored.iloc[0]
    misfit = rmse(record.t, record.v, run[list(names)].to_numpy(float), protocol.timing)
    seeds = stored.head(STORED_SEEDS)
    first = [first_generation_rmse(record, protocol, int(seed)) for seed in seeds["cma_seed"]]
    runs = pd.read_csv(workbook.ROOT / "results" / "table2_runs_authors.csv")
    spent = (runs["evaluations"] == protocol.population * runs["iterations"]).all()
    return _tests(
        the_signature_at_the_stored_parameters_has_the_stored_misfit=abs(misfit - run["final_rmse_rps"]) < 1e-9,
        every_stored_seed_gives_its_stored_first_generation=np.allclose(
            first, seeds["generation_1_best_rmse_rps"], rtol=0, atol=1e-12
        ),
        the_runs_of_table_2_spent_what_the_protocol_allows=bool(spent)
        and runs["iterations"].max() == protocol.iterations,
    )


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


def _verdicts(values: Found) -> dict[tuple[str, str, str], str]:
    """Verdict of each cell."""
    keys = [key for key in values if key[0] == "cell"]
    rows = [{"id": name, "source": source, "reproduced": values[kind, name, source]} for kind, name, source in keys]
    judged = judging.judge(pd.DataFrame(rows).assign(notebook=""))
    return dict(zip(keys, judged["verdict"], strict=True))


def noticing(before: Found, after: Found) -> list[tuple[str, str, str]]:
    """Cells, claims and tests whose verdict flips, or whose value moves by more than the cell's tolerance.

    What could not be computed any more notices too; only a cell that is reproduced can.
    """
    verdict_before, verdict_after = _verdicts(before), _verdicts(after)
    is_bound = published.cells()["kind"] == "bound"
    hits = []
    for key, value in before.items():
        kind, name, _ = key
        if verdict_before.get(key, "reproduced") != "reproduced":
            continue
        now = after.get(key, np.nan)
        if kind == "cell":
            moved = not is_bound[name] and not abs(now - value) <= published.tolerance(name)
            if moved or verdict_before[key] != verdict_after.get(key):
                hits.append(key)
        elif now != value:
            hits.append(key)
    return hits


def sensitivity() -> pd.DataFrame:
    """Change each constant and list who notices.

    Returns
    -------
    DataFrame
        A row a constant and cell, claim or test that notices it: `constant, value, changed, group, kind, id, source,
        before, after`; a constant that nothing notices has one row with an empty group.

    Raises
    ------
    DataUnavailable, DataCorrupt
        See `data.authors.authors_file`.
    """
    base = nominal()
    before = found(base)
    rows = []
    for change in changes(base):
        after = found(change.setup)
        head = {"constant": change.constant, "value": change.value, "changed": change.changed}
        hits = noticing(before, after)
        rows += [
            head
            | {"group": group(kind, name), "kind": kind, "id": name, "source": source}
            | {"before": before[kind, name, source], "after": after.get((kind, name, source), np.nan)}
            for kind, name, source in hits
        ]
        if not hits:
            rows.append(head | {"group": "", "kind": "", "id": "", "source": ""})
    return pd.DataFrame(rows)
