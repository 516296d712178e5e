"""The sensor's datasheet: what it says of logs of joints that are drawn apart from its fits (`benches`).

`python -m studies datasheet` draws them with a seed that nothing else uses, and writes results/datasheet.csv and the
page notebooks/datasheet.md.
"""

import math
from collections.abc import Sequence

import numpy as np
from joblib import Parallel, delayed
from pandas import DataFrame
from scipy.stats import binomtest

from backlash.estimates import estimate
from studies.benches import TURN, Fault, draw_log_uniform, draw_turns

SEED = 260711
LOAD_SDS = (0.1, 0.05)  # relative, by which inertia ratio and gravity are misjudged
BACKLASH_RAD = (2e-4, 2e-3)
# Population: load friction over gravity, loss in the gear, logs; every sixth joint is healthy.
TURNS = {
    "friction 0 to 20 %, loss 0 to 10 %": ((0.0, 0.2), (0.0, 0.1), 18),
    "friction 20 to 60 %, loss 0 to 10 %": ((0.2, 0.6), (0.0, 0.1), 18),
    "friction 0 to 20 %, loss 10 to 25 %": ((0.0, 0.2), (0.1, 0.25), 18),
    "friction 20 to 60 %, loss 10 to 25 %": ((0.2, 0.6), (0.1, 0.25), 18),
    "friction 0 to 60 %, loss 25 to 40 %": ((0.0, 0.6), (0.25, 0.4), 12),
}
# What the model lacks, each with friction of 0 to 40 % and a loss of 0 to 25 %.
FAULTS = {
    "second axis, 10 % of gravity": Fault(second_axis=0.1),
    "torque 10 ms late": Fault(late_torque_s=0.01),
    "torque low-passed at 30 Hz": Fault(torque_filter_s=1 / (TURN * 30)),
    "soft spring near zero torque": Fault(soft_share=0.4, soft_rad=3e-4),
    "gear's error, 3 a turn": Fault(transmission_rad=5e-4, transmission_order=3),
    "gear's error, 100 a turn": Fault(transmission_rad=5e-4, transmission_order=100),
    "gear ratio doubled": Fault(),
}
LOGS_OF_A_FAULT = 6


def measure_all(turns: int | None = None, of_a_fault: int = LOGS_OF_A_FAULT) -> DataFrame:
    """Ask the sensor about every population, a row a log; with `turns` about so many of each."""
    calls = [
        (name, number) for name, (*_, logs) in TURNS.items() for number in range(turns or logs)
    ]
    calls += [(name, number) for name in FAULTS for number in range(of_a_fault)]
    return DataFrame(Parallel(n_jobs=-1)(delayed(measure_log)(*call) for call in calls))


def measure_log(population: str, number: int) -> dict[str, object]:
    """Draw a log and ask the sensor."""
    rng = np.random.default_rng((SEED, [*TURNS, *FAULTS].index(population), number))
    delta = 0.0 if number % 6 == 5 else draw_log_uniform(rng, *BACKLASH_RAD)
    friction, loss, _ = TURNS.get(population, ((0.0, 0.4), (0.0, 0.25), 0))
    fault = FAULTS.get(population, Fault())
    log = draw_turns(rng, delta, rng.uniform(*friction), rng.uniform(*loss), fault)
    inertia, gravity = np.exp(rng.standard_normal(2) * LOAD_SDS)
    answer = estimate(
        log.t,
        log.v,
        unit="rps",
        torque=log.torque,
        gear_ratio=log.gear_ratio * (2 if population == "gear ratio doubled" else 1),
        inertia_ratio=inertia * log.inertia_ratio,
        gravity_per_s2=gravity * log.gravity_per_s2,
    )
    low, high = answer.backlash_interval_rad or (math.nan, math.nan)
    return {
        "population": population,
        "delta_rad": delta,
        "verdict": answer.verdict,
        "reason": answer.reason or "",
        "backlash_rad": math.nan if answer.backlash_rad is None else answer.backlash_rad,
        "low_rad": low,
        "high_rad": high,
    }


def summarise(rows: DataFrame) -> DataFrame:
    """Of each population: joints with backlash, how many are answered and covered; healthy joints and those called."""
    return DataFrame(
        [_summary(str(name), part) for name, part in rows.groupby("population", sort=False)]
    )


def _summary(population: str, part: DataFrame) -> dict[str, object]:
    ill, healthy = part[part["delta_rad"] > 0], part[part["delta_rad"] == 0]
    answered = ill[ill["verdict"] == "backlash"]
    covered = (answered["low_rad"] <= answered["delta_rad"]) & (
        answered["delta_rad"] <= answered["high_rad"]
    )
    reasons = part["reason"].where(part["verdict"] == "cannot tell").value_counts()
    return {
        "population": population,
        "joints": len(ill),
        "answered": len(answered),
        "covered": int(covered.sum()),
        "false_all_clears": int((ill["verdict"] == "no backlash").sum()),
        "healthy": len(healthy),
        "healthy_called": int((healthy["verdict"] == "backlash").sum()),
        "healthy_cleared": int((healthy["verdict"] == "no backlash").sum()),
        "reasons": "; ".join(f"{reason} {count}" for reason, count in reasons.items()),
    }


def describe_rate(count: int, of: int) -> str:
    """A share with its exact 95 % interval."""
    ends = binomtest(count, of).proportion_ci()
    return f"{count} of {of} ({100 * ends.low:.0f} to {100 * ends.high:.0f} %)"


def write_page(sheet: DataFrame) -> str:
    """The page: turns by friction and loss, faults, limits; at most 300 words."""
    turns, faults = sheet[: len(TURNS)], sheet[len(TURNS) :]
    total = turns.sum(numeric_only=True)
    lines = [
        "# The sensor's datasheet",
        "",
        f"Simulated joints of other code than the sensor's, seed {SEED}, drawn once: rings of 12 to 50 Hz, half plays "
        "of 0.2 to 2 mrad, gears of 50 to 160, 333 to 1000 Hz, load data wrong by 10 and 5 % (SD). 95 % intervals: "
        f"{describe_rate(int(total['answered']), int(total['joints']))} answered, "
        f"{describe_rate(int(total['covered']), int(total['answered']))} of these covered, "
        f"{int(total['false_all_clears'])} false all-clears, "
        f"{describe_rate(int(total['healthy_called']), int(total['healthy']))} healthy joints called.",
        "",
        *_table(turns),
        "",
        "With a fault that the model lacks:",
        "",
        *_table(faults),
        "",
        "Limits: the joint turns round at constant speed, about a horizontal axis, with friction and losses below "
        "gravity; it rings at 10 to 60 Hz; half plays below 0.05 mrad count as none; 250 samples a second or more. "
        "The backlash is proportional to the gravity that is given. Strokes to and fro are not answered.",
        "",
    ]
    return "\n".join(lines)


def _table(rows: DataFrame) -> Sequence[str]:
    head = ["| joints | answered | covered | healthy called | why not |", "|-|-|-|-|-|"]
    return head + [
        f"| {row.population} | {row.answered} of {row.joints} | {row.covered} | "
        f"{row.healthy_called} of {row.healthy} | "
        f"{row.reasons} |"
        for row in rows.itertuples()
    ]
