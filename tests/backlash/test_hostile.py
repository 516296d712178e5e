"""Files with bytes changed at random: a record or one clear line, never a traceback."""

import gzip
from dataclasses import replace

import numpy as np
import pytest

from backlash.reading.prepare import open_log
from backlash.refusals import Refusal
from tests.logs import TURN, file, noisy, rewritten, table, text

DATED = text("timestamp;speed [rpm];I [A]", "2024-03-17 12:00:0{t:.4f};{rpm:.2f};1,5")
KINDS = {
    "csv": lambda folder: text().encode(),
    "gz": lambda folder: gzip.compress(text().encode()),
    "utf16": lambda folder: text().encode("utf-16"),
    "xlsx": lambda folder: rewritten(folder / "log.xlsx", {}).read_bytes(),
    "parquet": lambda folder: table(noisy()).to_parquet(),
    "dates": lambda folder: DATED.replace(".", ",").encode(),
}


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """A log with some bytes changed, moved, doubled or lost, mostly near its start."""
    made = bytearray(content)
    for _ in range(rng.integers(1, 20)):
        at = int(rng.integers(len(made)) ** rng.uniform(0.2, 1))
        length = int(rng.integers(1, 2 ** rng.integers(1, 12)))
        piece = made[at : at + length]
        other = (
            b"",
            piece * 2,
            rng.bytes(len(piece)),
            b",",
            b"\n",
            b"9" * length,
            b"-",
            b'"',
            b"nan",
        )
        made[at : at + length] = other[rng.integers(len(other))]
    return bytes(made)


def read(path, form=TURN) -> str:
    """The columns that were read, or the refusal."""
    try:
        return open_log(path, form).columns
    except Refusal as refusal:
        return str(refusal)


def is_one_line(said: str) -> bool:
    return 0 < len(said) < 1000 and said.isprintable()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(12))
def test_a_mutated_log_is_read_or_refused_in_one_line(kind, seed, tmp_path):
    rng = np.random.default_rng(([*KINDS].index(kind), seed))
    path = file(tmp_path, mutated(KINDS[kind](tmp_path), rng), "log")
    assert is_one_line(read(path))


@pytest.mark.parametrize("seed", range(150))
def test_a_file_of_random_cells_is_read_or_refused_in_one_line(seed, tmp_path):
    rng = np.random.default_rng(seed)
    cells = [
        "0",
        "1.5",
        "2,5",
        "1e9",
        "-",
        "nan",
        "time",
        "v [rpm]",
        '"',
        "",
        "12:00:00.1",
        "é",
        "[",
    ]
    marks = [*',;\t \n\n\n"\r']
    words = [
        cells[rng.integers(len(cells))] + marks[rng.integers(len(marks))]
        for _ in range(rng.integers(1, 200))
    ]
    form = (
        replace(TURN, unit="rps", rate_hz=500.0) if seed % 2 else replace(TURN, time="1", speed="2")
    )
    assert is_one_line(read(file(tmp_path, "".join(words), "log"), form))
