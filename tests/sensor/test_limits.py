"""What a plant, or somebody hostile, can hand to the sensor: one line, little time and memory, nothing left behind."""

import gzip
import os
import resource
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np
import pytest

from tests.logs import command, file, noisy, rewritten, text, write

CPU_S = 20
MEMORY_KB = 2**20
TURN = ["--turn-period", "0.4"]
# A pipe into which nobody writes is given up at once.
MAIN = """
from backlash.main import main
from backlash.reading import sources
sources.PATIENCE_S = 0.5
raise SystemExit(main())
"""


def ran(folder: Path, *words, stdin=subprocess.DEVNULL) -> tuple[int, str, str]:
    """Exit status of a command in a process of its own, and what it printed; its limits are checked."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (2 * CPU_S, 2 * CPU_S))
        resource.setrlimit(resource.RLIMIT_AS, (8 * 2**30, 8 * 2**30))

    (folder / "temporary").mkdir()
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    with TemporaryFile("w+") as out, TemporaryFile("w+") as err:
        process = subprocess.Popen(
            [sys.executable, "-c", MAIN, *map(str, words)],
            cwd=Path(__file__).parents[2],
            env=os.environ
            | {
                "OPENBLAS_NUM_THREADS": "1",
                "PYTHONWARNINGS": "default",
                "TMPDIR": str(folder / "temporary"),
            },
            stdin=stdin,
            stdout=out,
            stderr=err,
            preexec_fn=limited,
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        printed = [os.pread(stream.fileno(), 2**20, 0).decode() for stream in (out, err)]
    assert used.ru_utime + used.ru_stime < CPU_S
    assert used.ru_maxrss < MEMORY_KB
    assert "Warning" not in printed[1]
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    return process.returncode, *printed


def sheet(rows: bytes) -> bytes:
    start = (
        b'<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>'
    )
    return start + rows + b"</sheetData></worksheet>"


SHEET = "xl/worksheets/sheet1.xml"
STYLES = b'<styleSheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><cellXfs>'
ELSEWHERE = (
    b'<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="rId1" '
    b'Type="http://schemas.openxmlformats.org/officeDocument/2006/relationships/worksheet" Target="/xl/media/a.xml"/>'
    b"</Relationships>"
)


def parquet(folder: Path, columns: int, are_decimals: bool = False) -> Path:
    pyarrow = pytest.importorskip("pyarrow", reason="reading Parquet needs the extra 'parquet'")
    from pyarrow import parquet

    path = folder / "log.parquet"
    column = pyarrow.array(np.arange(2_000_000) % 7)
    if are_decimals:
        column = column.cast(pyarrow.decimal128(20, 0))
    names = ["t", "v", *(f"c{k}" for k in range(2, columns))]
    parquet.write_table(pyarrow.table(dict.fromkeys(names, column)), path)
    return path


def fifo(folder: Path) -> Path:
    os.mkfifo(folder / "fifo")
    return folder / "fifo"


def sparse(folder: Path) -> Path:
    with (folder / "sparse").open("wb") as made:
        made.truncate(2**31)
    return folder / "sparse"


def bomb(folder: Path) -> Path:
    return file(folder, gzip.compress(bytes(2**29), 6), "bomb.csv.gz")


def log(folder: Path) -> Path:
    return write(noisy(), folder / "log.csv")


def scaled(seconds: float, header="time [s],speed [rps]", rps: float = 1.0) -> str:
    rows = (f"{seconds * t:.6g},{rps * v:.6g}" for t, v in zip(noisy().t, noisy().v, strict=True))
    return "\n".join([header, *rows])


def known(folder: Path, backlash: str) -> Path:
    log(folder)
    return file(folder, f"log,backlash_rad\nlog.csv,{backlash}\n", "known.csv")


def huge_number(folder: Path) -> Path:
    start = '{"method": "energy", "range_rad": [0, 1], "uncertainty_rad": '
    return file(folder, start + "9" * 400 + "}", "c.json")


# What is handed over, as words of a command, and a part of the line with which it is refused.
HOSTILE = {
    "rows of 200,000 fields": (
        lambda f: [file(f, "t,v\n" + "1," * 200_000 + "\n" + "1,2\n" * 2400)],
        "more than 64 columns",
    ),
    "a field of 60,000 digits": (
        lambda f: [file(f, "t,v\n" + "1," + "1" * 60_000 + "x\n" + "1,2\n" * 9)],
        "no column of time among '1', '111",
    ),
    "a name of 60,000 letters": (
        lambda f: [file(f, "t," + "a [" * 20_000 + "\n" + "1,2\n" * 9)],
        "",
    ),
    "styles of 15 million entries": (
        lambda f: [rewritten(f / "log.xlsx", {"xl/styles.xml": STYLES + b"<xf/>" * 15_000_000})],
        "xl/styles.xml unpacks to 72 MiB, above 4",
    ),
    "a row of 20 million cells": (
        lambda f: [
            rewritten(f / "log.xlsx", {SHEET: sheet(b"<row>" + b"<c/>" * 20_000_000 + b"</row>")})
        ],
        "more than 2,500,000 cells",
    ),
    "a sheet in another folder": (
        lambda f: [
            rewritten(
                f / "log.xlsx",
                {
                    "xl/_rels/workbook.xml.rels": ELSEWHERE,
                    "xl/media/a.xml": sheet(b"<row/>" * 15_000_000),
                },
            )
        ],
        "more than 2,000,000 rows",
    ),
    "a sheet in UTF-16": (
        lambda f: [
            rewritten(
                f / "log.xlsx", {SHEET: sheet(b"<row/>" * 5_000_000).decode().encode("utf-16")}
            )
        ],
        "its sheet is in UTF-16",
    ),
    "64 columns of 2 million rows": (lambda f: [parquet(f, 64)], "export time and speed alone"),
    "7 columns of 2 million decimals": (
        lambda f: [parquet(f, 7, are_decimals=True)],
        "its time stamp",
    ),
    "nanoseconds that are seconds": (
        lambda f: [file(f, scaled(1.0, "time [ns],speed [rps]"))],
        "samples a second: are the stamps in s?",
    ),
    "stamps times 1e-300": (
        lambda f: [file(f, scaled(1e-300))],
        "samples a second: are the stamps in s?",
    ),
    "speeds of 1e-298": (lambda f: [file(f, scaled(1.0, rps=1e-300))], ""),
    "speeds that overflow": (lambda f: [file(f, text().replace("100.", "1e39", 3))], ""),
    "a pipe without an end as a log": (lambda f: [fifo(f)], "nothing came out of it"),
    "an endless device": (lambda f: ["/dev/zero"], "more than the 64 MiB"),
    "a table on a pipe": (lambda f: ["--batch", fifo(f)], "nothing came out of it"),
    "a table on an endless device": (lambda f: ["--batch", "/dev/zero"], "more than the 16 MiB"),
    "a sparse table": (lambda f: ["--batch", sparse(f)], "more than the 16 MiB"),
    "a packed table": (lambda f: ["--batch", bomb(f)], "more than the 64 MiB"),
    "a calibration on a pipe": (lambda f: [log(f), "--calibration", fifo(f)], "nothing came out"),
    "a sparse calibration": (lambda f: [log(f), "--calibration", sparse(f)], "more than the 16"),
    "a calibration in brackets": (
        lambda f: [log(f), "--calibration", file(f, "[" * 100_000, "c.json")],
        "not a calib",
    ),
    "a calibration of 400 digits": (
        lambda f: [log(f), "--calibration", huge_number(f)],
        "not a calibration file",
    ),
    "dates on a pipe": (lambda f: ["TREND", log(f), "--dates", fifo(f)], "nothing came out"),
    "a known backlash with its unit": (
        lambda f: ["CALIBRATE", known(f, "0.300 mrad"), "--out", f / "c.json"],
        "'0.300 mrad', no finite number",
    ),
    "a name of 300 characters": (lambda f: ["x" * 300 + ".csv"], "check"),
    "an output of 300 characters": (lambda f: [log(f), "--out", "x" * 300 + ".csv"], "check"),
}
# One of each way in: each is a process, which takes a second to start.
QUICK = ("rows of 200,000 fields", "a table on a pipe", "a calibration in brackets")


@pytest.mark.parametrize(
    "kind",
    [kind if kind in QUICK else pytest.param(kind, marks=pytest.mark.slow) for kind in HOSTILE],
)
def test_hostile_input_is_one_line_in_little_time_and_memory(kind, tmp_path):
    make, why = HOSTILE[kind]
    words = make(tmp_path)
    name = words.pop(0).lower() if words[0] in ("TREND", "CALIBRATE") else "estimate"
    status, out, err = ran(tmp_path, name, *words, *TURN)
    if why:
        assert (status, out, err.count("\n")) == (2, "", 1), err
        assert why in err
        assert len(err) < 2000
    else:
        assert status in (0, 2)
        assert "Traceback" not in err
        assert "defect" not in err


@pytest.mark.slow
def test_a_standard_input_without_an_end_is_given_up(tmp_path):
    with Path("/dev/zero").open("rb") as endless:
        status, out, err = ran(tmp_path, "estimate", "-", *TURN, stdin=endless)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "more than the 64 MiB" in err


@pytest.mark.slow
def test_a_pipe_of_a_command_is_a_log_and_a_table(tmp_path):
    log(tmp_path)
    table = f"file,turn_period_s\n{tmp_path}/log.csv,0.4\n"
    read, write_end = os.pipe()
    os.write(write_end, table.encode())
    os.close(write_end)
    name = f"/proc/{os.getpid()}/fd/{read}"
    status, out, _ = ran(tmp_path, "estimate", "--batch", name, "--method", "energy")
    assert (status, ": backlash " in out) == (0, True)


def test_a_link_that_was_planted_is_not_written_through(tmp_path):
    victim = file(tmp_path, "mine", "victim")
    for name in (".out.csv.tmp", "out.csv.kept"):
        (tmp_path / name).symlink_to(victim)
    assert command("estimate", log(tmp_path), *TURN, "--out", tmp_path / "out.csv") == 2
    (tmp_path / "out.csv.kept").unlink()
    assert command("estimate", log(tmp_path), *TURN, "--out", tmp_path / "out.csv") == 0
    assert victim.read_text() == "mine"
