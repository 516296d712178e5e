"""From a log file to a table of columns: text, XLSX and Parquet.

Log files are untrusted input: their kind is told by content, and size and archive headers are
verified.
"""

import csv
import gzip
import io
import re
import warnings
import zipfile
import zlib
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import BinaryIO

import pandas as pd

from backlash.reading.refusals import UnusableLog, library

# An hour at 500 Hz is 1.8 million rows, and a log needs some 5 s of it.
MOST_ROWS = 2_000_000
MOST_BYTES = 64 * 2**20
MOST_COLUMNS = 64
# What a workbook of that size may unpack to; its XML takes some 100 bytes a cell.
MOST_UNPACKED_BYTES = 128 * 2**20
MOST_ZIP_MEMBERS = 1000
_LONGEST_LINE = 2**16
_CUT = "cut it to the test movement, a minute at most"
_UNREADABLE = {
    FileNotFoundError: "no such file in {}; check the name",
    PermissionError: "no permission to read it; ask its owner for it",
    MemoryError: "too large for this machine's memory; cut it to the test movement",
}

# Parquet columns that may hold a signal; text and nested ones may unpack to anything.
_NUMERIC = ("int", "uint", "float", "double", "halffloat", "timestamp", "decimal")
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_DIALECTS = (
    *((delimiter, mark) for delimiter in "\t;|" for mark in ".,"),
    (",", "."),
    (r"\s+", "."),
    (r"\s+", ","),
)
_DATE = re.compile(
    r"(\d{4}-\d\d-\d\d[T ]|\d\d\.\d\d\.\d{4}[T ])?\d\d:\d\d(:\d\d([.,]\d+)?)?(Z|[+-]\d\d:?\d\d)?"
)
_GROUPED = r"[+-]?\d{1,3}(,\d{3})+\.\d+"  # with marks of thousands
_NUMBER = re.compile(
    rf"{_GROUPED}|[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE
)
_ROW = re.compile(rb"<(\w+:)?row\b")  # of a workbook's sheet
_UNIT_WORD = re.compile(r"[\[(<]?\s*[A-Za-z°µ%/.^\-0-9]{0,8}( ?s\^?-1)?\s*[\])>]?")


def read_table(path: Path) -> pd.DataFrame:
    """Columns of a log file by name, or from 1 without a header; the index is the file's row."""
    try:
        return _read_file(path)
    except UnusableLog:
        raise
    except (OSError, EOFError, zlib.error, csv.Error, ValueError, MemoryError) as error:
        other = f"cannot be read ({error}); check its name, or export it again"  # broken gzip, an impossible name
        why = _UNREADABLE.get(type(error), other)
        raise UnusableLog(why.replace("{}", str(path.absolute().parent))) from error


def _read_file(path: Path) -> pd.DataFrame:
    """Read a file of bearable size by its first bytes."""
    if path.is_dir():
        raise UnusableLog("a folder where a log file is needed; name a file in it")
    if path.exists() and not path.is_file():
        raise UnusableLog("not a regular file; copy the log into one")
    with path.open("rb") as file:
        head = file.read(32)
    if not head:
        raise UnusableLog("the file is empty; export the log again")
    if head.startswith(b"PAR1"):
        return _read_parquet(path)
    _check_bytes(path.stat().st_size)
    if head.startswith(b"PK"):
        return _read_workbook(path)
    with gzip.open(path) if head.startswith(b"\x1f\x8b") else path.open("rb") as file:
        return _read_text(file)


def _read_parquet(path: Path) -> pd.DataFrame:
    """Read the numbers of a Parquet file."""
    parquet = library("pyarrow.parquet", "parquet")
    try:
        with parquet.ParquetFile(path) as file:
            flat = [
                field.name for field in file.schema_arrow if str(field.type).startswith(_NUMERIC)
            ]
            _check_size(file.metadata.num_rows, len(flat))
            frame = file.read(columns=flat).to_pandas(ignore_metadata=True)
    except UnusableLog:
        raise
    except Exception as error:  # whatever hostile bytes make the library raise
        problem = f"a broken Parquet file ({type(error).__name__}: {str(error)[:200]})"
        raise UnusableLog(f"{problem}; export the log again, or as CSV") from error
    if frame.shape[1] < 2:
        raise UnusableLog(
            "no two columns of numbers in this Parquet file; export time and speed as CSV"
        )
    frame.index = frame.index + 1
    return frame


def _check_bytes(size: int) -> None:
    if size > MOST_BYTES:
        raise UnusableLog(f"more than the {MOST_BYTES // 2**20} MiB that are read; {_CUT}")


def _check_size(rows: int, columns: int) -> None:
    if rows > MOST_ROWS:
        raise UnusableLog(f"more than {MOST_ROWS:,} rows; {_CUT}")
    if columns > MOST_COLUMNS:
        raise UnusableLog(f"more than {MOST_COLUMNS} columns; export time and speed alone")


def _named(frame: pd.DataFrame, above: Sequence[Sequence[str]], first: int) -> pd.DataFrame:
    """Name columns by the rows above the numbers, number rows as the file does, and drop blank rows and columns."""
    _check_size(*frame.shape)
    names = [
        name or str(number + 1) for number, name in enumerate(_header_names(above, frame.shape[1]))
    ]
    frame.columns = [
        name if names.count(name) == 1 else f"{name} ({k + 1})" for k, name in enumerate(names)
    ]
    frame.index = frame.index + first + 1
    return frame.dropna(how="all").dropna(how="all", axis=1)


def _header_names(rows: Sequence[Sequence[str]], columns: int) -> list[str]:
    """Names of the columns from the rows above the numbers; a row of units goes to the row of names above it."""
    fitting = [
        [str(field).strip().strip('"') for field in row] for row in rows if len(row) == columns
    ]
    names = fitting[-1] if fitting else [""] * columns
    if len(fitting) > 1 and all(_UNIT_WORD.fullmatch(field) for field in names):
        units = [unit.strip("[]()") for unit in names]
        if any(len(field) > len(unit) for field, unit in zip(fitting[-2], units, strict=True)):
            names = [f"{field} [{unit}]" for field, unit in zip(fitting[-2], units, strict=True)]
    return names


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == r"\s+":
        return line.split()
    return [
        field.strip()
        for field in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    ]


def _numbers(line: str, delimiter: str, decimal: str) -> list[str]:
    """Fields of a line that are numbers, with "." as decimal mark, or date-times."""
    fields = [field.strip('"') for field in _split(line, delimiter)]
    swapped = [
        field.translate(str.maketrans(",.", ".,")) if decimal == "," else field for field in fields
    ]
    return [
        s
        for s, field in zip(swapped, fields, strict=True)
        if _NUMBER.fullmatch(s) or _DATE.fullmatch(field)
    ]


def _find_dialect(lines: Sequence[str]) -> tuple[str, str]:
    """Delimiter and decimal mark that read most lines as two numbers or more."""

    def score(dialect: tuple[str, str]) -> float:
        counts = [len(_numbers(line, *dialect)) for line in lines]
        return sum(count >= 2 for count in counts) + 1e-3 * sum(min(count, 10) for count in counts)

    best = max(_DIALECTS, key=score)
    if score(best) < 1:
        raise UnusableLog(
            "no rows with two numbers (header only, or no table); export the log again"
        )
    return best


def _read_text(file: BinaryIO | gzip.GzipFile) -> pd.DataFrame:
    """Read text in the encodings of loggers and spreadsheets."""
    content = file.read(MOST_BYTES + 1)
    _check_bytes(len(content))
    if content.startswith(_UTF16):
        return _table_of(content.decode("utf-16", errors="replace"))
    if b"\0" in content[:_LONGEST_LINE] or content.startswith(b"%PDF"):
        raise UnusableLog(
            "neither text nor .xlsx nor Parquet; export the log as CSV, or hand its columns over from Python"
        )
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:  # Latin-1 takes any bytes
        text = content.decode("latin-1")
    return _table_of(text)


def _table_of(text: str) -> pd.DataFrame:
    """Find the table in a text."""
    head = re.split(r"\r\n|\r|\n", text[:_LONGEST_LINE])[:400]
    if len(head) < 2 and len(text) >= _LONGEST_LINE:
        raise UnusableLog(
            f"its first line is longer than {_LONGEST_LINE} characters; that is no log"
        )
    filled = [
        (number, line.lstrip("#%").strip())
        for number, line in enumerate(head)
        if line.strip("#%,;\t \r")
    ]
    if not filled:
        raise UnusableLog("nothing but blank lines; export the log again")
    last = [line for _, line in filled[-50:]]
    delimiter, decimal = _find_dialect(last)
    grouped = any(
        re.fullmatch(_GROUPED, field)
        for line in last
        for field in _numbers(line, delimiter, decimal)
    )
    first = next(number for number, line in filled if len(_numbers(line, delimiter, decimal)) >= 2)
    above = [_split(line, delimiter) for number, line in filled if number < first]
    try:
        frame = pd.read_csv(
            io.StringIO(text),
            sep=delimiter,
            decimal=decimal,
            header=None,
            skiprows=first,
            nrows=MOST_ROWS + 1,
            skip_blank_lines=False,
            skipinitialspace=True,
            low_memory=False,
            thousands={",": ".", ".": ","}[decimal] if grouped else None,
        )
    except (ValueError, pd.errors.ParserError, OverflowError) as error:
        raise UnusableLog(f"not a table ({error}); export the log again") from error
    return _named(frame, above, first)


def _inspect_workbook(path: Path) -> None:
    """See by its directory that a workbook is one, without macros and not too large; no part unpacks to more."""
    refused = "a zip archive that is no plain workbook"
    with zipfile.ZipFile(path) as bundle:
        members = bundle.infolist()
        names = {member.filename for member in members}
        if "xl/workbook.xml" not in names:
            raise UnusableLog(
                f"{refused} (it has no xl/workbook.xml); unpack it, or save the log as CSV"
            )
        declared = sum(member.file_size for member in members)
        if len(members) > MOST_ZIP_MEMBERS or declared > MOST_UNPACKED_BYTES:
            size = f"{declared / 2**20:,.0f} MiB, above {MOST_UNPACKED_BYTES // 2**20}"
            parts = f"{refused}: {len(members)} parts that unpack to {size}"
            raise UnusableLog(f"{parts}; save the test movement alone, as CSV")
        # Counted first, because the library takes a gigabyte for millions of empty rows.
        for name in names:
            if name.startswith("xl/worksheets/"):
                _check_size(sum(1 for _ in _ROW.finditer(bundle.read(name))), 0)
        macros = any(name.lower().endswith("vbaproject.bin") for name in names)
        if macros or b"macroEnabled" in bundle.read("[Content_Types].xml"):
            raise UnusableLog("a workbook with macros; save it as .xlsx without them")


def _read_workbook(path: Path) -> pd.DataFrame:
    """Read a workbook's first sheet as text; formulas by stored results (defusedxml refuses entities)."""
    load_workbook = library("openpyxl", "xlsx").load_workbook
    text = io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    try:
        _inspect_workbook(path)
        with (
            warnings.catch_warnings(action="ignore"),
            closing(load_workbook(path, read_only=True, data_only=True, keep_links=False)) as book,
        ):
            book.worksheets[0].reset_dimensions()
            for number, row in enumerate(book.worksheets[0].iter_rows(values_only=True)):
                _check_size(number, len(row))
                writer.writerow(row)
    except UnusableLog:
        raise
    except Exception as error:  # whatever hostile bytes make the libraries raise
        raise UnusableLog(
            f"not a readable workbook ({type(error).__name__}: {error}); save the log as CSV"
        ) from error
    return _table_of(text.getvalue())
