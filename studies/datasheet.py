"""The sensor's datasheet: what it says of logs of joints that are drawn apart from its fits (`simulated_joints`).

`python -m studies datasheet` draws them with a seed that nothing else uses, and writes results/datasheet.csv and the
page notebooks/datasheet.md.
"""

import math
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator
from pandas import DataFrame, MultiIndex, concat
from scipy.stats import binomtest

from backlash.estimates import Estimate, estimate
from backlash.refusals import Reason, Refusal
from studies.simulated_joints import (
    ORDINARY,
    TO_AND_FRO,
    TURN,
    Fault,
    JointLog,
    Ranges,
    draw_log,
    draw_log_uniform,
)

SEED = 926177
LOAD_SDS = (0.1, 0.05)  # relative, by which inertia ratio and gravity are misjudged


class Population(NamedTuple):
    """What the logs of a row are drawn from; every sixth joint is healthy."""

    logs: int
    friction: tuple[float, float] = (0.0, 0.4)  # of the load, over gravity
    loss: tuple[float, float] = (0.0, 0.25)  # in the gear
    fault: Fault = Fault()
    ranges: Ranges = ORDINARY
    backlash_rad: tuple[float, float] = (2e-4, 2e-3)


TURNS = {
    f"friction {100 * friction[0]:g} to {100 * friction[1]:g} %, "
    f"loss {100 * loss[0]:g} to {100 * loss[1]:g} %": Population(18, friction, loss)
    for friction, loss in (
        ((0.0, 0.2), (0.0, 0.1)),
        ((0.2, 0.6), (0.0, 0.1)),
        ((0.0, 0.2), (0.1, 0.25)),
        ((0.2, 0.6), (0.1, 0.25)),
        ((0.0, 0.6), (0.25, 0.4)),
    )
}
# Of a wider range: turns by rings, gears of 6 to 300.
WIDE_TURNS_S, WIDE_RINGS_HZ = ((0.25, 1.0), (1.0, 4.0), (4.0, 20.0)), ((12.0, 25.0), (25.0, 50.0))
WIDE_GEARS = tuple(np.geomspace(6, 300, 100))
WIDE = {
    f"ring of {rings[0]:g} to {rings[1]:g} Hz, turn of {turns[0]:g} to {turns[1]:g} s": Population(
        12, ranges=Ranges(turns, WIDE_GEARS, rings), backlash_rad=(1e-4, 5e-3)
    )
    for rings in WIDE_RINGS_HZ
    for turns in WIDE_TURNS_S
}
DOUBLED = "gear ratio doubled"
_FAULTS = {
    "second axis, 10 % of gravity": Fault(second_axis=0.1),
    "torque 10 ms late": Fault(late_torque_s=0.01),
    "torque low-passed at 30 Hz": Fault(torque_filter_s=1 / (TURN * 30)),
    "second axis at half the turn's rate": Fault(second_axis=0.05, second_axis_turns=0.5),
    "second axis at 1.5 times the turn's rate": Fault(second_axis=0.05, second_axis_turns=1.5),
    "torque a mean over 25 ms": Fault(torque_mean=50),
    "speed and torque means over 16 ms": Fault(torque_mean=32, speed_mean=32),
    "each value held for 4 samples": Fault(held=4),
    "teeth soft to 0.4 over 0.3 mrad": Fault(soft_share=0.4, soft_rad=3e-4),
    "teeth soft to 0.6 over 0.2 mrad": Fault(soft_share=0.6, soft_rad=2e-4),
    "a quarter of the damping in the gap": Fault(drag=0.25),
    "all of the damping in the gap": Fault(drag=1.0),
    "gear's error, 3 a turn": Fault(transmission_rad=5e-4, transmission_order=3),
    "gear's error, 100 a turn": Fault(transmission_rad=5e-4, transmission_order=100),
    DOUBLED: Fault(),
}
FAULTS = {name: Population(4, fault=fault) for name, fault in _FAULTS.items()}
# By which the sensor says what is wrong.
TRUE_REASONS = dict.fromkeys(FAULTS, (Reason.NO_FIT,)) | {
    "second axis, 10 % of gravity": (Reason.NOT_PERIODIC, Reason.NO_FIT),
    "second axis at half the turn's rate": (Reason.NOT_PERIODIC,),
    "second axis at 1.5 times the turn's rate": (Reason.NOT_PERIODIC,),
    "speed and torque means over 16 ms": (Reason.AMBIGUOUS, Reason.NO_FIT),
    "each value held for 4 samples": (Reason.TOO_SLOWLY_SAMPLED,),
    DOUBLED: (Reason.WRONG_PERIOD,),
}
# To and fro: ordinary joints; with more friction and loss; with a gear's error of 0.1 mrad and soft teeth.
STROKES = {
    "strokes": Population(18, (0.0, 0.2), (0.0, 0.1), ranges=TO_AND_FRO),
    "strokes, friction": Population(12, (0.2, 0.4), (0.1, 0.25), ranges=TO_AND_FRO),
    "strokes, faults": Population(
        12,
        (0.0, 0.3),
        (0.0, 0.2),
        Fault(transmission_rad=1e-4, transmission_order=2, soft_share=0.7, soft_rad=1e-4),
        ranges=TO_AND_FRO,
    ),
}
NORMAL_95 = 1.96
# Beside the backlash, each with its SD.
TOLD = ("stiffness_per_s2", "damping_ratio", "friction_share", "loss")


POPULATIONS = TURNS | WIDE | FAULTS | STROKES


def measure_population(population: str) -> DataFrame:
    """Ask the sensor about each log of a population: a row of the datasheet."""
    logs = range(POPULATIONS[population].logs)
    return summarise(DataFrame(measure_log(population, number) for number in logs))


def measure_log(population: str, number: int) -> dict[str, object]:
    """Draw a log and ask the sensor; the errors of what it tells beside the backlash are in SDs."""
    rng = np.random.default_rng((SEED, [*POPULATIONS].index(population), number))
    drawn = POPULATIONS[population]
    delta = 0.0 if number % 6 == 5 else draw_log_uniform(rng, *drawn.backlash_rad)
    rubbing = rng.uniform(*drawn.friction), rng.uniform(*drawn.loss)
    log = draw_log(rng, delta, *rubbing, drawn.fault, drawn.ranges)
    gear_ratio = log.gear_ratio * (2 if population == DOUBLED else 1)
    answer = ask_sensor(misjudge(rng, log), gear_ratio=gear_ratio)
    row = {"population": population, "delta_rad": delta} | describe_answer(answer)
    if answer.verdict == "backlash" and answer.joint:
        told = ((name, *answer.joint[name]) for name in TOLD if name in answer.joint)
        row |= {name: (value - log.true[name]) / sd for name, value, sd in told}
    return row


def misjudge(rng: Generator, log: JointLog) -> JointLog:
    """A log whose load is known with `LOAD_SDS`."""
    inertia, gravity = np.exp(rng.standard_normal(2) * LOAD_SDS)
    return log._replace(
        inertia_ratio=inertia * log.inertia_ratio, gravity_per_s2=gravity * log.gravity_per_s2
    )


def ask_sensor(log: JointLog, **others: Any) -> Estimate:
    """What the sensor says of a log, with other options than the log's own."""
    given = {"unit": "rps"} | log._asdict() | others
    t, _ = given.pop("t"), given.pop("true")
    try:
        return estimate(t, **given)
    except Refusal as refusal:  # of the record, before any fit
        return Estimate("").with_refusal(refusal)


def describe_answer(answer: Estimate) -> dict[str, object]:
    """What a row has of an answer."""
    low, high = answer.backlash_interval_rad or (math.nan, math.nan)
    return {
        "verdict": answer.verdict,
        "reason": answer.reason or "",
        "backlash_rad": answer.backlash_rad,
        "low_rad": low,
        "high_rad": high,
    }


def summarise(rows: DataFrame) -> DataFrame:
    """Of each population: joints with backlash, how many are answered and covered; healthy joints and those called.

    Of all its logs, `right` are covered or rightly told to have none, `true_reason` refused for what is wrong with
    them, and `wrong` neither right nor refused. Under the names of `TOLD` are the answers whose quantity is within 1.96
    SDs of the truth, of those that tell it.
    """
    is_ill = rows["delta_rad"] > 0
    is_answered, is_cleared, is_refused = (
        rows["verdict"] == verdict for verdict in ("backlash", "no backlash", "cannot tell")
    )
    is_covered = is_ill & is_answered & rows["delta_rad"].between(rows["low_rad"], rows["high_rad"])
    is_right = is_covered | (~is_ill & is_cleared)
    true = [(name, reason.value) for name in FAULTS for reason in TRUE_REASONS[name]]
    errors = rows.reindex(columns=[*TOLD]).where(is_ill & is_answered).abs()
    counted = {
        "joints": is_ill,
        "answered": is_ill & is_answered,
        "covered": is_covered,
        "false_all_clears": is_ill & is_cleared,
        "healthy": ~is_ill,
        "healthy_called": ~is_ill & is_answered,
        "healthy_cleared": ~is_ill & is_cleared,
        "right": is_right,
        "true_reason": MultiIndex.from_frame(rows[["population", "reason"]]).isin(true),
        "wrong": ~is_refused & ~is_right,
        **(errors < NORMAL_95),
        **errors.notna().add_suffix("_told"),
    }
    counts = DataFrame(counted).groupby(rows["population"], sort=False).sum()
    reasons = rows["reason"].where(is_refused).groupby(rows["population"], sort=False)
    counts["reasons"] = [
        "; ".join(f"{reason} {count}" for reason, count in each.value_counts().items())
        for _, each in reasons
    ]
    return counts.reset_index()


def describe_rate(count: int, of: int) -> str:
    """A share with its exact 95 % interval."""
    ends = binomtest(count, of).proportion_ci()
    return f"{count} of {of} ({100 * ends.low:.0f} to {100 * ends.high:.0f} %)"


def summarise_engine(rows: DataFrame) -> DataFrame:
    """The same of the physics engine's logs (`studies.engine`), healthy ones beside the others."""
    asked = rows[rows["verdict"].notna()]
    names = "MuJoCo, " + asked["population"].str.removesuffix(", healthy")
    return summarise(asked.assign(population=names))


def _write_ranges(wide: DataFrame) -> list[str]:
    """A table of the wider range, turns by rings."""
    cells = iter(f"{row.covered} / {row.answered} / {row.joints}" for row in wide.itertuples())
    heads = ["Ring, by turn", *(f"{low:g}-{high:g} s" for low, high in WIDE_TURNS_S)]
    lines = [heads, ["-"] * len(heads)]
    for low, high in WIDE_RINGS_HZ:
        lines.append([f"{low:g}-{high:g} Hz", *islice(cells, len(WIDE_TURNS_S))])
    return [f"| {' | '.join(line)} |" for line in lines]


def write_page(sheet: DataFrame, engine: DataFrame) -> str:
    """The page: turns by friction and loss, the physics engine's, faults, limits; at most 300 words."""
    turns, wide, faults, strokes = (
        sheet[sheet["population"].isin(names)] for names in (TURNS, WIDE, FAULTS, STROKES)
    )
    total = turns.sum(numeric_only=True).astype(int)
    lines = [
        "# The sensor's datasheet",
        "",
        f"Simulated joints, drawn by other code; seed ({SEED}) and numbers of logs were fixed "
        "before, the sensor's limits on other seeds' logs and MuJoCo's. "
        "Rings of 12 to 50 Hz, half plays of 0.2 to 2 mrad or "
        "none, gears of 50 to 160, 333 to 1000 Hz, twelve turns, load data off by 10 and 5 % (SD). In all, with 95 % "
        "intervals: answered "
        f"{describe_rate(total['answered'], total['joints'])}; of these the interval holds the truth in "
        f"{describe_rate(total['covered'], total['answered'])}; false all-clears "
        f"{describe_rate(total['false_all_clears'], total['joints'])}; healthy joints called "
        f"{describe_rate(total['healthy_called'], total['healthy'])}.",
        "",
        "| By torque | answered | covered | healthy called |",
        "|-|-|-|-|",
        *(
            f"| {row.population} | {row.answered} of {row.joints} | {row.covered} | "
            f"{row.healthy_called} of {row.healthy} |"
            for row in concat([turns, strokes, engine]).itertuples()
        ),
        "",
        f"Quantities within {NORMAL_95} SDs, where told: "
        + ", ".join(f"{name.split('_')[0]} {total[name]}/{total[f'{name}_told']}" for name in TOLD)
        + ".",
        "",
        "MuJoCo is an independent physics engine; its gears drag in the gap, all six of its arm's yield.",
        "",
        "Gears of 6 to 300, half plays of 0.1 to 5 mrad: covered / answered / joints with play.",
        "",
        *_write_ranges(wide),
        "",
        "| With a fault | right | refused for it | refused otherwise | wrong |",
        "|-|-|-|-|-|",
        *(
            f"| {row.population} | {row.right} | {row.true_reason} | "
            f"{row.joints + row.healthy - row.right - row.true_reason - row.wrong} | {row.wrong} |"
            for row in faults.itertuples()
        ),
        "",
        "Limits: rings of 10 to 60 Hz; half plays below 0.05 mrad count as none; 250 Hz or more; "
        "friction and losses below gravity.",
        "",
    ]
    return "\n".join(lines)
