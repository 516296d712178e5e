"""A plain log, and ways to write and read it, for the tests of the reading."""

from functools import lru_cache

import numpy as np
import pytest

from backlash.reading.columns import LogFormat
from backlash.reading.prepare import read_log
from backlash.refusals import UnusableLog
from replication.recording import Recording, add_uniform_noise
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import identified_joint

TURN = LogFormat(turn_period_s=0.4)


@lru_cache
def plain() -> Recording:
    """Twelve turns of the paper's joint, 9e-4 rad, in noise."""
    record = simulate_recordings(identified_joint(), [9e-4])[0]
    return add_uniform_noise(record, 0.1, np.random.default_rng(1))


def read(path, form=TURN) -> Recording:
    return read_log(path, form)[0]


def refusal(path, form=TURN) -> str:
    """The one line with which a log is refused."""
    with pytest.raises(UnusableLog) as caught:
        read_log(path, form)
    line = str(caught.value)
    assert "\n" not in line
    assert len(line) < 600
    return line


def text(header="time [s],speed [rps]", row="{t:.6f},{v:.5f}", record=None) -> str:
    record = record or plain()
    rows = [
        row.format(t=t, v=v, ns=round(1e9 * t), rpm=60 * v, rad=2 * np.pi * v, deg=360 * v)
        for t, v in zip(record.t, record.v, strict=True)
    ]
    return "\n".join([*([header] if header else []), *rows, ""])
