"""Logs with bytes changed at random. No part of `make test` or `make slow`: run it by its name, as once a week."""

import gzip

import numpy as np
import pytest

from tests.logs import command, file, noisy, rewritten, table, text
from tests.sensor.test_limits import TURN


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """A log with some bytes changed, moved, doubled or lost."""
    made = bytearray(content)
    for _ in range(rng.integers(1, 20)):
        at, length = rng.integers(len(made)), int(rng.integers(1, 2 ** rng.integers(1, 12)))
        piece = made[at : at + length]
        other = (b"", piece * 2, rng.bytes(len(piece)), b",", b"\n", b"9" * length, b"-", b"nan")
        made[at : at + length] = other[rng.integers(len(other))]
    return bytes(made)


@pytest.mark.parametrize("seed", range(300))
def test_a_mutated_log_is_answered_or_refused_in_one_line(seed, tmp_path, capsys):
    rng = np.random.default_rng(seed)
    kinds = {
        "csv": text().encode(),
        "gz": gzip.compress(text().encode()),
        "utf16": text().encode("utf-16"),
        "xlsx": rewritten(tmp_path / "log.xlsx", {}).read_bytes(),
        "parquet": table(noisy()).to_parquet(),
    }
    content = kinds[list(kinds)[seed % len(kinds)]]
    path = file(tmp_path, mutated(content, rng))
    status = command("estimate", path, *TURN, "--method", "energy")
    captured = capsys.readouterr()
    assert status in (0, 2), captured.err
    assert captured.err.count("\n") == (status == 2)
    assert (captured.out + captured.err).replace("\n", "").isprintable()
