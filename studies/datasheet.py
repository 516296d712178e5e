"""The sensor's datasheet: what it says of logs of joints that are drawn apart from its fits (`simulated_joints`).

`python -m studies datasheet` draws them with a seed that nothing else uses, and writes results/datasheet.csv and the
page notebooks/datasheet.md.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.random import Generator
from pandas import DataFrame
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

SEED = 926151
LOAD_SDS = (0.1, 0.05)  # relative, by which inertia ratio and gravity are misjudged
BACKLASH_RAD = (2e-4, 2e-3)
# Population: load friction over gravity, loss in the gear, logs; every sixth joint is healthy.
TURNS = {
    "friction 0 to 20 %, loss 0 to 10 %": ((0.0, 0.2), (0.0, 0.1), 18),
    "friction 20 to 60 %, loss 0 to 10 %": ((0.2, 0.6), (0.0, 0.1), 18),
    "friction 0 to 20 %, loss 10 to 25 %": ((0.0, 0.2), (0.1, 0.25), 18),
    "friction 20 to 60 %, loss 10 to 25 %": ((0.2, 0.6), (0.1, 0.25), 18),
    "friction 0 to 60 %, loss 25 to 40 %": ((0.0, 0.6), (0.25, 0.4), 18),
}
# Of a wider range: turns by rings, gears of 6 to 300, friction of 0 to 40 %, a loss of 0 to 25 %.
WIDE_BACKLASH_RAD = (1e-4, 5e-3)
WIDE_TURNS_S, WIDE_RINGS_HZ = ((0.25, 1.0), (1.0, 4.0), (4.0, 20.0)), ((12.0, 25.0), (25.0, 50.0))
WIDE = {
    f"ring of {rings[0]:g} to {rings[1]:g} Hz, turn of {turns[0]:g} to {turns[1]:g} s": Ranges(
        turns, tuple(np.geomspace(6, 300, 100)), rings
    )
    for rings in WIDE_RINGS_HZ
    for turns in WIDE_TURNS_S
}
LOGS_OF_A_RANGE = 12
# Faults, each with friction of 0 to 40 % and a loss of 0 to 25 %, and the reasons that say so.
FAULTS = {
    "second axis, 10 % of gravity": (Fault(second_axis=0.1), (Reason.NOT_PERIODIC, Reason.NO_FIT)),
    "torque 10 ms late": (Fault(late_torque_s=0.01), (Reason.NO_FIT,)),
    "torque low-passed at 30 Hz": (Fault(torque_filter_s=1 / (TURN * 30)), (Reason.NO_FIT,)),
    "second axis at half the turn's rate": (
        Fault(second_axis=0.05, second_axis_turns=0.5),
        (Reason.NOT_PERIODIC,),
    ),
    "second axis at 1.5 times the turn's rate": (
        Fault(second_axis=0.05, second_axis_turns=1.5),
        (Reason.NOT_PERIODIC,),
    ),
    "torque a mean over 25 ms": (Fault(torque_mean_s=0.025), (Reason.NO_FIT,)),
    "speed and torque means over 16 ms": (
        Fault(torque_mean_s=0.016, speed_mean_s=0.016),
        (Reason.AMBIGUOUS, Reason.NO_FIT),
    ),
    "each value held for 4 samples": (Fault(held=4), (Reason.TOO_SLOWLY_SAMPLED,)),
    "teeth soft to 0.4 over 0.3 mrad": (Fault(soft_share=0.4, soft_rad=3e-4), (Reason.NO_FIT,)),
    "teeth soft to 0.6 over 0.2 mrad": (Fault(soft_share=0.6, soft_rad=2e-4), (Reason.NO_FIT,)),
    "a quarter of the damping in the gap": (Fault(drag=0.25), (Reason.NO_FIT,)),
    "all of the damping in the gap": (Fault(drag=1.0), (Reason.NO_FIT,)),
    "gear's error, 3 a turn": (
        Fault(transmission_rad=5e-4, transmission_order=3),
        (Reason.NO_FIT,),
    ),
    "gear's error, 100 a turn": (
        Fault(transmission_rad=5e-4, transmission_order=100),
        (Reason.NO_FIT,),
    ),
    "gear ratio doubled": (Fault(), (Reason.WRONG_PERIOD,)),
}
LOGS_OF_A_FAULT = 4
# To and fro: ordinary joints; with more friction and loss; with a gear's error of 0.1 mrad and soft teeth.
STROKES = {
    "strokes": ((0.0, 0.2), (0.0, 0.1), Fault(), 18),
    "strokes, friction": ((0.2, 0.4), (0.1, 0.25), Fault(), 12),
    "strokes, faults": (
        *((0.0, 0.3), (0.0, 0.2)),
        Fault(transmission_rad=1e-4, transmission_order=2, soft_share=0.7, soft_rad=1e-4),
        12,
    ),
}
NORMAL_95 = 1.96
# Beside the backlash, each with its SD.
TOLD = ("stiffness_per_s2", "damping_ratio", "friction_share", "loss")


POPULATIONS = (*TURNS, *WIDE, *FAULTS, *STROKES)


def measure_all(populations: Iterable[str] = POPULATIONS) -> DataFrame:
    """Ask the sensor about every population, or some, a row a log."""
    logs = {name: logs for name, (*_, logs) in TURNS.items()}
    logs |= dict.fromkeys(WIDE, LOGS_OF_A_RANGE)
    logs |= dict.fromkeys(FAULTS, LOGS_OF_A_FAULT)
    logs |= {name: logs for name, (*_, logs) in STROKES.items()}
    calls = [(name, number) for name in populations for number in range(logs[name])]
    return DataFrame(Parallel(n_jobs=-1)(delayed(measure_log)(*call) for call in calls))


def measure_log(population: str, number: int) -> dict[str, object]:
    """Draw a log and ask the sensor; the errors of what it tells beside the backlash are in SDs."""
    rng = np.random.default_rng((SEED, POPULATIONS.index(population), number))
    plays = WIDE_BACKLASH_RAD if population in WIDE else BACKLASH_RAD
    delta = 0.0 if number % 6 == 5 else draw_log_uniform(rng, *plays)
    friction, loss, _ = TURNS.get(population, ((0.0, 0.4), (0.0, 0.25), 0))
    fault, _ = FAULTS.get(population, (Fault(), ()))
    if population in STROKES:
        friction, loss, fault, _ = STROKES[population]
    drawn = rng.uniform(*friction), rng.uniform(*loss)
    ranges = TO_AND_FRO if population in STROKES else WIDE.get(population, ORDINARY)
    log = draw_log(rng, delta, *drawn, fault, ranges)
    gear_ratio = log.gear_ratio * (2 if population == "gear ratio doubled" else 1)
    try:
        answer = ask_sensor(misjudge(rng, log), gear_ratio=gear_ratio)
    except Refusal as refusal:  # of the record, before any fit
        answer = Estimate("", reason=refusal.reason.value)
    row = {"population": population, "delta_rad": delta} | describe_answer(answer)
    if answer.verdict == "backlash" and answer.joint:
        told = ((name, *answer.joint[name]) for name in TOLD)
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
    load = {name: getattr(log, name) for name in ("gear_ratio", "inertia_ratio", "gravity_per_s2")}
    return estimate(log.t, log.v, **{"unit": "rps", "torque": log.torque} | load | others)


def describe_answer(answer: Estimate) -> dict[str, object]:
    """What a row has of an answer."""
    low, high = answer.backlash_interval_rad or (math.nan, math.nan)
    return {
        "verdict": answer.verdict,
        "reason": answer.reason or "",
        "backlash_rad": math.nan if answer.backlash_rad is None else answer.backlash_rad,
        "low_rad": low,
        "high_rad": high,
    }


def summarise(rows: DataFrame) -> DataFrame:
    """Of each population: joints with backlash, how many are answered and covered; healthy joints and those called.

    Of all its logs, `right` are covered or rightly told to have none, `true_reason` refused for what is wrong with
    them, and `wrong` neither right nor refused. Under the names of `TOLD` are the answers whose quantity is within 1.96
    SDs of the truth.
    """
    return DataFrame(
        [_summary(str(name), part) for name, part in rows.groupby("population", sort=False)]
    )


def _summary(population: str, part: DataFrame) -> dict[str, object]:
    is_ill, is_refused = part["delta_rad"] > 0, part["verdict"] == "cannot tell"
    is_answered, is_cleared = part["verdict"] == "backlash", part["verdict"] == "no backlash"
    is_covered = is_answered & part["delta_rad"].between(part["low_rad"], part["high_rad"])
    is_right = (is_ill & is_covered) | (~is_ill & is_cleared)
    _, true = FAULTS.get(population, (None, ()))
    reasons = part.loc[is_refused, "reason"].value_counts()
    errors = part.reindex(columns=[*TOLD])[is_ill & is_answered].abs()
    return {
        "population": population,
        "joints": int(is_ill.sum()),
        "answered": int((is_ill & is_answered).sum()),
        "covered": int((is_ill & is_covered).sum()),
        "false_all_clears": int((is_ill & is_cleared).sum()),
        "healthy": int((~is_ill).sum()),
        "healthy_called": int((~is_ill & is_answered).sum()),
        "healthy_cleared": int((~is_ill & is_cleared).sum()),
        "right": int(is_right.sum()),
        "true_reason": int((is_refused & part["reason"].isin([each.value for each in true])).sum()),
        "wrong": int((~is_refused & ~is_right).sum()),
        **(errors < NORMAL_95).sum(),
        "reasons": "; ".join(f"{reason} {count}" for reason, count in reasons.items()),
    }


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
    cells = [f"{row.covered} / {row.answered} / {row.joints}" for row in wide.itertuples()]
    heads = [f"{low:g}-{high:g} s" for low, high in WIDE_TURNS_S]
    rings = [f"{low:g}-{high:g} Hz" for low, high in WIDE_RINGS_HZ]
    rows = [[ring, *cells[len(heads) * k :][: len(heads)]] for k, ring in enumerate(rings)]
    lines = [["Ring, by turn", *heads], ["-"] * (1 + len(heads)), *rows]
    return [f"| {' | '.join(line)} |" for line in lines]


def write_page(sheet: DataFrame, engine: DataFrame) -> str:
    """The page: turns by friction and loss, the physics engine's, faults, limits; at most 300 words."""
    sheet = sheet.set_index("population", drop=False)
    turns, wide, faults, strokes = (
        sheet[sheet.index.isin(names)] for names in (TURNS, WIDE, FAULTS, STROKES)
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
            for row in [*turns.itertuples(), *strokes.itertuples(), *engine.itertuples()]
        ),
        "",
        f"Of these {total['answered']} answers' other quantities, within 1.96 SDs: "
        + ", ".join(f"{name.split('_')[0]} {total[name]}" for name in TOLD)
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
