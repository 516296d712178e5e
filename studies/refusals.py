"""The rules by which a log is refused before any fit: how often of sound logs, and of those that they are made for.

Sound logs are of simulated joints, written as loggers write them: speed or position, rounded, as float32, at 100 to
1000 Hz, with stamps that jitter or have whole milliseconds, from rest or in full motion. Faulty ones are these with one
fault each.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.random import Generator
from pandas import DataFrame, Series, concat
from scipy.signal import lfilter

from backlash.reading.columns import LogOptions
from backlash.reading.prepare import open_log
from backlash.refusals import Refusal
from backlash.torque.answer import refuse_averaged
from studies.simulated_joints import (
    CONTROL_S,
    ORDINARY,
    TURN,
    Fault,
    draw_joint,
    draw_log_uniform,
    follow_path,
    keeps_speed,
    running_mean,
)

SEED = 551903
JOINTS, WRITINGS = 60, 5
RATED = 2.0  # torque, over gravity's
_REST_S = 1.0
Damage: TypeAlias = Callable[[DataFrame, Generator], DataFrame]


def run_from_rest(rng: Generator) -> tuple[DataFrame, float, int]:
    """A joint at rest, then turning, each 0.5 ms: speed [rps], position [turns], torque; gear ratio; when settled."""
    while True:
        speed = TURN / draw_log_uniform(rng, *ORDINARY.turns_s)
        gear_ratio = float(rng.choice(ORDINARY.gear_ratios))
        delta = draw_log_uniform(rng, 2e-4, 2e-3)
        joint = draw_joint(rng, delta, speed, gear_ratio, rng.uniform(0, 0.4), rng.uniform(0, 0.25))
        turn = round(TURN / speed / CONTROL_S)  # in periods of the control
        wanted = speed * np.minimum(np.arange(14 * turn) / turn, 1.0)
        seen = follow_path(joint, Fault(), joint.vertical_rad, wanted)
        if keeps_speed(joint, seen[2 * turn :], wanted[2 * turn :]):
            break
    rest = round(_REST_S / CONTROL_S)
    frame = DataFrame({"time": CONTROL_S * np.arange(rest + len(seen))})
    frame["speed"] = gear_ratio / TURN * np.pad(seen[:, 0], (rest, 0))
    frame["position"] = frame["speed"].cumsum() * CONTROL_S
    frame["torque"] = np.pad(seen[:, 1], (rest, 0), "edge") / joint.gravity
    return frame, gear_ratio, rest + 2 * turn


def write_log(
    run: DataFrame, gear_ratio: float, settled: int, rng: Generator
) -> tuple[DataFrame, LogOptions]:
    """The run as one of many loggers writes it: time, speed or position, torque."""
    every = int(rng.choice([2, 4, 6, 8, 10, 16, 20]))
    frame = run[settled * int(rng.integers(2)) :]
    low_pass = np.exp(-CONTROL_S / rng.choice([1e-9, 2e-3, 5e-3]))
    start = [low_pass * frame["speed"].iloc[0]]
    v = lfilter([1 - low_pass], [1, -low_pass], frame["speed"], zi=start)[0]
    frame = frame.assign(speed=v)[::every].reset_index(drop=True)
    noise = rng.standard_normal((2, len(frame)))
    time, position = frame["time"], frame["position"]
    v = frame["speed"] * (1 + rng.choice([0, 1e-4, 1e-3]) * noise[0])
    torque = frame["torque"] + rng.choice([1e-3, 2e-3, 1e-2]) * noise[1]
    stamps = [time, time + rng.uniform(-0.1, 0.1, len(frame)) * (every * CONTROL_S)]
    if every > 2:
        stamps.append(time.round(3))
    torques = [torque, _round(torque, 1e-3 * RATED), torque.astype("float32")]
    counts = 2.0 ** rng.integers(12, 24)
    signals = [
        ("speed [rps]", v),
        ("speed [rps]", v.astype("float32")),
        ("speed [rps]", _round(v, rng.choice([1e-3, 1e-6]))),
        ("speed [rpm]", _round(60 * v, rng.choice([0.1, 0.01]))),
        *[("position [counts]", np.floor(counts * position))] * 4,
    ]
    name, signal = signals[rng.integers(len(signals))]
    time, torque = stamps[rng.integers(len(stamps))], torques[rng.integers(3)]
    way = rng.choice([1, -1])  # in which it turns
    options = LogOptions(gear_ratio=gear_ratio, torque="torque", counts_per_turn=counts)
    return DataFrame({"time": time, name: way * signal, "torque": way * torque}), options


def _round(signal: Series, step: float) -> Series:
    return step * np.rint(signal / step)


def _hold(log: DataFrame, samples: int) -> DataFrame:
    """The log with each row in place of those after it."""
    return log.iloc[log.index // samples * samples].reset_index(drop=True)


def _freeze(log: DataFrame, rng: Generator) -> DataFrame:
    log, at = log.copy(), int(0.6 * len(log))
    log.iloc[at : at + rng.integers(20, 60), 1] = log.iloc[at, 1]
    return log


def _stray(log: DataFrame, rng: Generator) -> DataFrame:
    is_stray = log.index.isin(rng.integers(len(log) // 2, len(log), 3))
    return log.assign(torque=log["torque"].mask(is_stray, 10 * log["torque"].abs().max()))


# Each rule by the words of its refusal, with the fault that it is made for.
RULES: dict[str, tuple[str, Damage]] = {
    "frozen signal": ("frozen, or a stand-in", _freeze),
    "stand-in in the torque": (
        "frozen, or a stand-in",
        lambda log, rng: log.assign(
            torque=log["torque"].mask(log.index // 40 == len(log) // 60, -999.0)
        ),
    ),
    "stray torque": ("samples of the torque stray", _stray),
    "held values": (" stands for ", lambda log, rng: _hold(log, 4).assign(time=log["time"])),
    "torque a running mean of 4 to 8 samples": (
        "a running mean",
        lambda log, rng: log.assign(
            torque=running_mean(log["torque"].to_numpy(), int(rng.integers(4, 9)))
        ),
    ),
    "clipped torque": (
        "is clipped at",
        lambda log, rng: log.assign(torque=log["torque"].clip(upper=log["torque"].quantile(0.9))),
    ),
    "stamps that repeat": (
        "repeats the one before with other values",
        lambda log, rng: log.assign(time=_hold(log, 3)["time"]),
    ),
    "two runs in one log": ("run backward", lambda log, rng: concat([log, log])),
    "stamps in bursts": (
        "stamps come in bursts",
        lambda log, rng: log.assign(time=_hold(log, 4)["time"] + 1e-5 * (log.index % 4)),
    ),
    "a third of the samples lost": (
        "stamps come in bursts",
        lambda log, rng: log[rng.random(len(log)) > 1 / 3],
    ),
    "sampled below 84 Hz": (
        "; a ring of",
        lambda log, rng: log[:: round(1 / (60 * (log["time"].iloc[9] - log["time"].iloc[0]) / 9))],
    ),
    "a speed that drifts by 5 %": (
        "not constant speed",
        lambda log, rng: log.assign(
            **{log.columns[1]: log.iloc[:, 1] * np.linspace(1, 1.05, len(log))}
        ),
    ),
    "two turns": ("too short", lambda log, rng: log[-len(log) // 7 :]),
}
OTHER = "none of these"


def refuse_log(log: DataFrame, options: LogOptions) -> str:
    """Why a log is refused before a fit; empty where it is not."""
    try:
        read = open_log(log, options)
        refuse_averaged(read.recording, read.signals[-1])
    except Refusal as refusal:
        return str(refusal)
    return ""


def measure_all(joints: int = JOINTS) -> DataFrame:
    """Of each rule how many sound logs it refuses, and how many of those that have its fault; a log a joint has it."""
    sound, damaged = [], []
    for number in range(joints):
        run = run_from_rest(np.random.default_rng((SEED, number)))
        for writing in range(WRITINGS):
            rng = np.random.default_rng((SEED, number, writing))
            log, options = write_log(*run, rng)
            sound.append(refuse_log(log, options))
        damaged.append([refuse_log(damage(log, rng), options) for _, damage in RULES.values()])
    refused, faulty = Series(sound), DataFrame(damaged, columns=[*RULES])
    is_false, is_caught = DataFrame(), DataFrame()
    for rule, (words, _) in RULES.items():
        is_false[rule] = refused.str.contains(words, regex=False)
        is_caught[rule] = faulty[rule].str.contains(words, regex=False)
    counted = {
        "false_refusals": is_false.sum(),
        "sound": len(sound),
        "caught": is_caught.sum(),
        "refused_otherwise": ((faulty != "") & ~is_caught).sum(),
        "faulty": joints,
    }
    table = DataFrame(counted)
    is_other = (refused != "") & ~is_false.any(axis=1)
    table.loc[OTHER, ["false_refusals", "sound"]] = is_other.sum(), len(sound)
    return table.rename_axis("rule").reset_index()
