"""The rules by which a log is refused before any fit: how often of sound logs, and of those that they are made for.

Sound logs are of simulated joints, written as loggers write them: speed or position, rounded, as float32, at 100 to
1000 Hz, with stamps that jitter or have whole milliseconds, from rest or in full motion. Faulty ones are these with one
fault each.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.random import Generator
from pandas import DataFrame, concat
from scipy.signal import lfilter

from backlash.reading.columns import LogOptions
from backlash.reading.prepare import open_log
from backlash.refusals import Refusal
from backlash.torque.answer import refuse_averaged
from studies.simulated_joints import (
    CONTROL_S,
    TURN,
    Fault,
    draw_joint,
    draw_log_uniform,
    follow_path,
)

SEED = 551903
JOINTS, WRITINGS = 60, 5
RATED = 2.0  # torque, over gravity's
_REST_S = 1.0
Damage: TypeAlias = Callable[[DataFrame, Generator], DataFrame]


def run_from_rest(rng: Generator) -> tuple[DataFrame, LogOptions, int]:
    """A joint at rest, then turning, each 0.5 ms: speed [rps], position [turns], torque; and where it is settled."""
    while True:
        speed = TURN / draw_log_uniform(rng, 0.5, 2.5)
        gear_ratio = float(rng.choice([50, 80, 100, 101, 121, 160]))
        delta = draw_log_uniform(rng, 2e-4, 2e-3)
        joint = draw_joint(rng, delta, speed, gear_ratio, rng.uniform(0, 0.4), rng.uniform(0, 0.25))
        periods = round(TURN / speed / CONTROL_S)  # of the control, in a turn
        path = speed * np.minimum(np.arange(14 * periods) / periods, 1.0)
        seen = follow_path(joint, Fault(), joint.vertical_rad, path)
        if np.abs(seen[2 * periods :, 0] / speed - 1).max() < 0.1:
            break
    rest = round(_REST_S / CONTROL_S)
    v = gear_ratio / TURN * np.pad(seen[:, 0], (rest, 0))
    frame = DataFrame({"time": CONTROL_S * np.arange(v.size), "speed": v})
    frame["position"] = v.cumsum() * CONTROL_S
    frame["torque"] = np.pad(seen[:, 1], (rest, 0), "edge") / joint.gravity
    return frame, LogOptions(gear_ratio=gear_ratio, torque="torque"), rest + 2 * periods


def write_log(
    run: DataFrame, options: LogOptions, settled: int, rng: Generator
) -> tuple[DataFrame, LogOptions]:
    """The run as one of many loggers writes it."""
    every = int(rng.choice([2, 4, 6, 8, 10, 16, 20]))
    frame = run[settled * int(rng.integers(2)) :]
    low_pass = np.exp(-CONTROL_S / rng.choice([1e-9, 2e-3, 5e-3]))
    start = [low_pass * frame["speed"].iloc[0]]
    v = lfilter([1 - low_pass], [1, -low_pass], frame["speed"], zi=start)[0]
    frame = frame.assign(speed=v)[::every].reset_index(drop=True)
    noise = rng.standard_normal((2, len(frame)))
    frame["speed"] *= 1 + rng.choice([0, 1e-4, 1e-3]) * noise[0]
    frame["torque"] += rng.choice([1e-3, 2e-3, 1e-2]) * noise[1]
    period = every * CONTROL_S
    jitter = rng.uniform(-0.1, 0.1, len(frame)) * period
    stamps = [frame["time"], frame["time"] + jitter]
    if every > 2:
        stamps.append(frame["time"].round(3))
    torques = [frame["torque"], _round(frame["torque"], 1e-3 * RATED), _as_float32(frame["torque"])]
    bits = int(rng.integers(12, 24))
    signals = [
        ("speed [rps]", frame["speed"]),
        ("speed [rps]", _as_float32(frame["speed"])),
        ("speed [rps]", _round(frame["speed"], float(rng.choice([1e-3, 1e-6])))),
        ("speed [rpm]", _round(60 * frame["speed"], float(rng.choice([0.1, 0.01])))),
        *[("position [counts]", np.floor(2**bits * frame["position"]))] * 4,
    ]
    name, signal = signals[rng.integers(len(signals))]
    time, torque = stamps[rng.integers(len(stamps))], torques[rng.integers(3)]
    way = rng.choice([1, -1])  # in which it turns
    written = DataFrame({"time": time, name: way * signal, "torque": way * torque})
    if "position" in name:
        options = replace(options, counts_per_turn=2.0**bits)
    return written, options


def _round(signal, step: float):
    return step * np.rint(signal / step)


def _as_float32(signal):
    return signal.astype("float32").astype(float)


def _change(column: int, change: Callable[[np.ndarray, Generator], np.ndarray]) -> Damage:
    """A fault of one column: 0 time, 1 speed or position, 2 torque."""

    def damage(log: DataFrame, rng: Generator) -> DataFrame:
        values = log.iloc[:, column].to_numpy(copy=True)
        return log.assign(**{log.columns[column]: change(values, rng)})

    return damage


def _freeze(x, rng):
    at = int(0.6 * x.size)
    x[at : at + rng.integers(20, 60)] = x[at]
    return x


def _stray(x, rng):
    x[rng.integers(x.size // 2, x.size, 3)] = 10 * np.abs(x).max()
    return x


def _hold(log, rng):
    at = np.arange(len(log)) // 4 * 4
    return log.assign(**{name: log[name].to_numpy()[at] for name in log.columns[1:]})


def _average(x, rng):
    width = int(rng.integers(4, 9))
    return np.convolve(np.pad(x, (width - 1, 0), "edge"), np.full(width, 1 / width), "valid")


# Each rule by the words of its refusal, with the fault that it is made for.
RULES: dict[str, tuple[str, Damage]] = {
    "frozen signal": ("frozen, or a stand-in", _change(1, _freeze)),
    "stand-in in the torque": (
        "frozen, or a stand-in",
        _change(2, lambda x, rng: np.where(np.arange(x.size) // 40 == x.size // 60, -999.0, x)),
    ),
    "stray torque": ("samples of the torque stray", _change(2, _stray)),
    "held values": (" stands for ", _hold),
    "torque a running mean of 4 to 8 samples": ("a running mean", _change(2, _average)),
    "clipped torque": (
        "is clipped at",
        _change(2, lambda x, rng: np.minimum(x, np.quantile(x, 0.9))),
    ),
    "stamps that repeat": (
        "repeats the one before with other values",
        _change(0, lambda t, rng: t[np.arange(t.size) // 3 * 3]),
    ),
    "two runs in one log": ("run backward", lambda log, rng: concat([log, log])),
    "stamps in bursts": (
        "stamps come in bursts",
        _change(0, lambda t, rng: t[np.arange(t.size) // 4 * 4] + 1e-5 * (np.arange(t.size) % 4)),
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
        _change(1, lambda x, rng: x * np.linspace(1, 1.05, x.size)),
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
    sound: list[str] = []
    faulty = []
    for number in range(joints):
        run = run_from_rest(np.random.default_rng((SEED, number)))
        for writing in range(WRITINGS):
            rng = np.random.default_rng((SEED, number, writing))
            log, options = write_log(*run, rng)
            sound.append(refuse_log(log, options))
        faulty.append([refuse_log(damage(log, rng), options) for _, damage in RULES.values()])
    others = {*filter(None, sound)}
    rows = []
    for (rule, (words, _)), reasons in zip(RULES.items(), zip(*faulty, strict=True), strict=True):
        caught = sum(words in reason for reason in reasons)
        row = {
            "rule": rule,
            "false_refusals": sum(words in reason for reason in sound),
            "sound": len(sound),
            "caught": caught,
            "refused_otherwise": sum(map(bool, reasons)) - caught,
            "faulty": joints,
        }
        rows.append(row)
        others = {reason for reason in others if words not in reason}
    refused = sum(reason in others for reason in sound)
    return DataFrame([*rows, {"rule": OTHER, "false_refusals": refused, "sound": len(sound)}])
