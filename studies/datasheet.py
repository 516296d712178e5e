"""The sensor's datasheet: what it says of logs of joints that are drawn apart from its fits (`simulated_joints`).

`python -m studies datasheet` draws them with a seed that nothing else uses, and writes results/datasheet.csv and the
page notebooks/datasheet.md.
"""

import math
from collections.abc import Iterable

import numpy as np
from joblib import Parallel, delayed
from pandas import DataFrame
from scipy.stats import binomtest

from backlash.estimates import Estimate, estimate
from backlash.refusals import Reason, Refusal
from studies.simulated_joints import TURN, Fault, draw_log_uniform, draw_turns

SEED = 402817
EARLIER_SEED = 830519  # a log of its draw had shown that the search lacked a start
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
NORMAL_95 = 1.96
# Beside the backlash, each with its SD.
TOLD = ("stiffness_per_s2", "damping_ratio", "friction_share", "loss")


def measure_all(populations: Iterable[str] = (*TURNS, *FAULTS)) -> DataFrame:
    """Ask the sensor about every population, or some, a row a log."""
    logs = {name: logs for name, (*_, logs) in TURNS.items()}
    logs |= dict.fromkeys(FAULTS, LOGS_OF_A_FAULT)
    calls = [(name, number) for name in populations for number in range(logs[name])]
    return DataFrame(Parallel(n_jobs=-1)(delayed(measure_log)(*call) for call in calls))


def measure_log(population: str, number: int) -> dict[str, object]:
    """Draw a log and ask the sensor; the errors of what it tells beside the backlash are in SDs."""
    rng = np.random.default_rng((SEED, [*TURNS, *FAULTS].index(population), number))
    delta = 0.0 if number % 6 == 5 else draw_log_uniform(rng, *BACKLASH_RAD)
    friction, loss, _ = TURNS.get(population, ((0.0, 0.4), (0.0, 0.25), 0))
    fault, _ = FAULTS.get(population, (Fault(), ()))
    log = draw_turns(rng, delta, rng.uniform(*friction), rng.uniform(*loss), fault)
    inertia, gravity = np.exp(rng.standard_normal(2) * LOAD_SDS)
    try:
        answer = estimate(
            log.t,
            log.v,
            unit="rps",
            torque=log.torque,
            gear_ratio=log.gear_ratio * (2 if population == "gear ratio doubled" else 1),
            inertia_ratio=inertia * log.inertia_ratio,
            gravity_per_s2=gravity * log.gravity_per_s2,
        )
    except Refusal as refusal:  # of the record, before any fit
        answer = Estimate("", reason=refusal.reason.value)
    row = {"population": population, "delta_rad": delta} | describe_answer(answer)
    if answer.verdict == "backlash" and answer.joint:
        told = ((name, *answer.joint[name]) for name in TOLD)
        row |= {name: (value - log.true[name]) / sd for name, value, sd in told}
    return row


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


def write_page(sheet: DataFrame, engine: DataFrame) -> str:
    """The page: turns by friction and loss, the physics engine's, faults, limits; at most 300 words."""
    turns, faults = sheet[: len(TURNS)], sheet[len(TURNS) :]
    total = turns.sum(numeric_only=True).astype(int)
    lines = [
        "# The sensor's datasheet",
        "",
        f"Simulated joints, drawn once by other code than the sensor's; seed ({SEED}) and numbers of logs were fixed "
        f"before, the sensor's limits on logs of other seeds; an earlier draw ({EARLIER_SEED}) had led to a change, "
        "and MuJoCo's logs to another. "
        "Rings of 12 to 50 Hz, half plays of 0.2 to 2 mrad or "
        "none, gears of 50 to 160, 333 to 1000 Hz, twelve turns, load data off by 10 and 5 % (SD). In all, with 95 % "
        "intervals: answered "
        f"{describe_rate(total['answered'], total['joints'])}; of these the interval holds the truth in "
        f"{describe_rate(total['covered'], total['answered'])}; false all-clears "
        f"{describe_rate(total['false_all_clears'], total['joints'])}; healthy joints called "
        f"{describe_rate(total['healthy_called'], total['healthy'])}.",
        "",
        "| By torque, turning round | answered | covered | healthy called |",
        "|-|-|-|-|",
        *(
            f"| {row.population} | {row.answered} of {row.joints} | {row.covered} | "
            f"{row.healthy_called} of {row.healthy} |"
            for row in [*turns.itertuples(), *engine.itertuples()]
        ),
        "",
        f"Of these {total['answered']} answers' other quantities, within 1.96 SDs of the truth: "
        + ", ".join(f"{name.split('_')[0]} {total[name]}" for name in TOLD)
        + ".",
        "",
        "MuJoCo is an independent physics engine. In the gap its gears drag by up to all of the spring's damping; its "
        "arm has six axes, whose gears all yield.",
        "",
        "| With a fault | right | refused for it | refused otherwise | wrong |",
        "|-|-|-|-|-|",
        *(
            f"| {row.population} | {row.right} | {row.true_reason} | "
            f"{row.joints + row.healthy - row.right - row.true_reason - row.wrong} | {row.wrong} |"
            for row in faults.itertuples()
        ),
        "",
        "Limits: rings of 10 to 60 Hz; half plays below 0.05 mrad count as none; 250 samples a second or more; load "
        "friction and losses below gravity. Strokes to and fro are not answered.",
        "",
    ]
    return "\n".join(lines)
