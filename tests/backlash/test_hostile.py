"""Files with bytes changed at random: a record or one clear line, never a traceback."""

import gzip
from itertools import product

import numpy as np
import pytest

from backlash.refusals import Refusal
from tests.logs import file, frame, read, rewritten, text

PIECES = b",", b"\n", b"-", b'"', b"nan"
CELLS = ["0", "1.5", "2,5", "1e9", "-", "nan", "time", "v [rpm]", '"', "", "12:00:00.1", "é", "["]
CELLS = [cell + mark for cell in CELLS for mark in ',;\t \n\n\n"\r']
DATED = text("timestamp;speed [rpm];I [A]", "2024-03-17 12:00:0{t:.4f};{rpm:.2f};1,5")
KINDS = {
    "csv": lambda folder: text().encode(),
    "gz": lambda folder: gzip.compress(text().encode()),
    "utf16": lambda folder: text().encode("utf-16"),
    "xlsx": lambda folder: rewritten(folder / "log.xlsx", {}).read_bytes(),
    "parquet": lambda folder: frame().to_parquet(),
    "dates": lambda folder: DATED.replace(".", ",").encode(),
}


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """A log with some bytes changed, moved, doubled or lost, mostly near its start."""
    made = bytearray(content)
    for _ in range(rng.integers(1, 20)):
        at = int(rng.integers(len(made)) ** rng.uniform(0.2, 1))
        length = int(rng.integers(1, 2 ** rng.integers(1, 12)))
        piece = made[at : at + length]
        others = (b"", piece * 2, rng.bytes(len(piece)), b"9" * length, *PIECES)
        made[at : at + length] = others[rng.integers(len(others))]
    return bytes(made)


@pytest.mark.parametrize(
    ("kind", "seed"), [*product([*KINDS], range(12)), *product(["cells"], range(150))]
)
def test_what_is_changed_at_random_is_read_or_refused_in_one_line(kind, seed, tmp_path):
    rng = np.random.default_rng(seed)
    given = {}
    if kind in KINDS:
        content = mutated(KINDS[kind](tmp_path), rng)
    else:
        content = "".join(rng.choice(CELLS, rng.integers(1, 200)))
        given = {"unit": "rps", "rate_hz": 500.0} if seed % 2 else {"time": "1", "speed": "2"}
    try:
        line = str(read(file(tmp_path, content, "log"), **given).columns)
    except Refusal as refusal:
        line = str(refusal)
    assert 0 < len(line) < 1000
    assert line.isprintable()
