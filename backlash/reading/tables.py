"""From a log's bytes to a table of columns: text, XLSX and Parquet.

Log files are untrusted input: their kind is told by content, and what they unpack to is bounded
before it is read.
"""

import csv
import io
import posixpath
import re
import warnings
import zipfile
from collections.abc import Sequence
from contextlib import closing

import pandas as pd

from backlash.refusals import Refusal, library

# An hour at 500 Hz is 1.8 million rows, and a log needs some 5 s of it.
MOST_ROWS = 2_000_000
MOST_COLUMNS = 64
MOST_CELLS = 16_000_000
# A workbook's XML takes some 50 bytes a cell, and a microsecond or more.
MOST_UNPACKED_BYTES = 128 * 2**20
MOST_SHEET_CELLS = 2_500_000
MOST_PART_BYTES = 4 * 2**20  # of all but the sheets, which are read whole
MOST_ZIP_MEMBERS = 1000
_LONGEST_LINE = 2**16
_LONGEST_NUMBER = 60  # characters
CUT = "cut it to the test movement, a minute at most"

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
    rf"{_GROUPED}|[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE
)
# Of a workbook's sheet.
_ROW = re.compile(rb"<(\w+:)?row\b")
_CELL = re.compile(rb"<(\w+:)?c\b")
_IS_SHEET = "/worksheet"  # ends the type of a relation
_UNIT_WORD = re.compile(r"[\[(<]?\s*[A-Za-z°µ%/.^\-0-9]{0,8}( ?s\^?-1)?\s*[\])>]?")


def read_table(content: bytes, least: int = 2) -> pd.DataFrame:
    """Columns of a log, `least` or more, by name, or from 1 without a header; the index is the file's row."""
    if not content:
        raise Refusal("the file is empty; export the log again")
    if content.startswith(b"PAR1"):
        return _read_parquet(content, least)
    if content.startswith(b"PK"):
        return _table_of(_read_workbook(content), "utf-8", least)
    return _table_of(content, _encoding(content), least)


def _read_parquet(content: bytes, least: int) -> pd.DataFrame:
    """Read the numbers of a Parquet file."""
    parquet = library("pyarrow.parquet", "parquet")
    float64 = library("pyarrow", "parquet").float64()
    try:
        with parquet.ParquetFile(io.BytesIO(content)) as file:
            flat = [
                field.name for field in file.schema_arrow if str(field.type).startswith(_NUMERIC)
            ]
            _check_size(file.metadata.num_rows, len(flat))
            table = file.read(columns=flat, use_threads=False)
        for number, field in enumerate(table.schema):
            if str(field.type).startswith("decimal"):  # else each number becomes an object
                numbers = table.column(number).cast(float64)
                table = table.set_column(number, field.name, numbers)
        frame = table.to_pandas(ignore_metadata=True)
    except Refusal:
        raise
    except Exception as error:  # whatever hostile bytes make the library raise
        problem = f"a broken Parquet file ({type(error).__name__}: {str(error)[:200]})"
        raise Refusal(f"{problem}; export the log again, or as CSV") from error
    if frame.shape[1] < least:
        raise Refusal(
            "no two columns of numbers in this Parquet file; export time and speed as CSV"
        )
    frame.index = frame.index + 1
    return frame


def _check_size(rows: int, columns: int) -> None:
    if rows > MOST_ROWS:
        raise Refusal(f"more than {MOST_ROWS:,} rows; {CUT}")
    if columns > MOST_COLUMNS:
        raise Refusal(f"more than {MOST_COLUMNS} columns; export time and speed alone")
    if rows * columns > MOST_CELLS:
        raise Refusal(f"{rows:,} rows of {columns} columns; export time and speed alone")


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
        if len(s) <= _LONGEST_NUMBER and (_NUMBER.fullmatch(s) or _DATE.fullmatch(field))
    ]


def _find_dialect(lines: Sequence[str], least: int) -> tuple[str, str]:
    """Delimiter and decimal mark that read most lines as `least` numbers or more."""

    def score(dialect: tuple[str, str]) -> float:
        counts = [len(_numbers(line, *dialect)) for line in lines]
        return sum(count >= least for count in counts) + 1e-3 * sum(
            min(count, 10) for count in counts
        )

    best = max(_DIALECTS, key=score)
    if score(best) < 1:
        raise Refusal("no rows with two numbers (header only, or no table); export the log again")
    return best


def _encoding(content: bytes) -> str:
    """The encoding of a text, among those of loggers and spreadsheets."""
    if content.startswith(_UTF16):
        return "utf-16"
    if b"\0" in content[:_LONGEST_LINE] or content.startswith(b"%PDF"):
        raise Refusal(
            "neither text nor .xlsx nor Parquet; export the log as CSV, or hand its columns over from Python"
        )
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:  # Latin-1 takes any bytes
        return "latin-1"
    return "utf-8-sig"


def _table_of(content: bytes, encoding: str, least: int) -> pd.DataFrame:
    """Find the table in a text."""
    text = content[: 2 * _LONGEST_LINE].decode(encoding, "replace")[:_LONGEST_LINE]
    head = re.split(r"\r\n|\r|\n", text)[:400]
    if len(head) < 2 and len(text) >= _LONGEST_LINE:
        raise Refusal(f"its first line is longer than {_LONGEST_LINE} characters; that is no log")
    filled = [
        (number, line.lstrip("#%").strip())
        for number, line in enumerate(head)
        if line.strip("#%,;\t \r")
    ]
    if not filled:
        raise Refusal("nothing but blank lines; export the log again")
    last = [line for _, line in filled[-50:]]
    delimiter, decimal = _find_dialect(last, least)
    grouped = any(
        re.fullmatch(_GROUPED, field)
        for line in last
        for field in _numbers(line, delimiter, decimal)
    )
    first = next(
        number for number, line in filled if len(_numbers(line, delimiter, decimal)) >= least
    )
    above = [_split(line, delimiter) for number, line in filled if number < first]
    # The parser makes all rows as wide as this one.
    _check_size(0, len(_split(head[first], delimiter)))
    try:
        frame = pd.read_csv(
            io.BytesIO(content),
            encoding=encoding,
            encoding_errors="replace",
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
        raise Refusal(f"not a table ({error}); export the log again") from error
    return _named(frame, above, first)


def _inspect_workbook(bundle: zipfile.ZipFile) -> None:
    """See that a workbook is one, without macros, and that no part of it unpacks to more than is read in seconds."""
    refused = "a zip archive that is no plain workbook"
    members = {member.filename: member.file_size for member in bundle.infolist()}
    if "xl/workbook.xml" not in members:
        raise Refusal(f"{refused} (it has no xl/workbook.xml); unpack it, or save the log as CSV")
    declared = sum(members.values())
    if len(bundle.infolist()) > MOST_ZIP_MEMBERS or declared > MOST_UNPACKED_BYTES:
        unpacked = f"{declared / 2**20:,.0f} MiB, above {MOST_UNPACKED_BYTES // 2**20}"
        parts = f"{refused}: {len(members)} parts that unpack to {unpacked}"
        raise Refusal(f"{parts}; save the test movement alone, as CSV")
    sheets = _sheets(bundle)
    for name, size in members.items():
        if size > MOST_PART_BYTES and name not in sheets:
            what = f"{name} unpacks to {size / 2**20:,.0f} MiB, above {MOST_PART_BYTES // 2**20}"
            raise Refusal(f"{refused}: {what}; save the log as CSV")
        if name in sheets:
            _count_cells(bundle.read(name))
    macros = any(name.lower().endswith("vbaproject.bin") for name in members)
    if macros or b"macroEnabled" in bundle.read("[Content_Types].xml"):
        raise Refusal("a workbook with macros; save it as .xlsx without them")


def _sheets(bundle: zipfile.ZipFile) -> set[str]:
    """Parts of a workbook that are its sheets, by their relations."""
    relations = bundle.getinfo("xl/_rels/workbook.xml.rels")
    if relations.file_size > MOST_PART_BYTES:
        return set()
    return {
        posixpath.normpath(posixpath.join("/xl", relation.get("Target", "")))[1:]
        for relation in library("defusedxml.ElementTree", "xlsx").fromstring(bundle.read(relations))
        if relation.get("Type", "").endswith(_IS_SHEET)
    }


def _count_cells(sheet: bytes) -> None:
    """Refuse a sheet of too many cells before the library takes gigabytes for it, also for empty ones."""
    if sheet.startswith(_UTF16) or b"\0" in sheet[:4]:
        raise Refusal("its sheet is in UTF-16, as no spreadsheet writes it; save the log as CSV")
    _check_size(sum(1 for _ in _ROW.finditer(sheet)), 0)
    cells = sum(1 for _ in _CELL.finditer(sheet))
    if max(cells, sheet.count(b"<") // 8) > MOST_SHEET_CELLS:
        raise Refusal(f"more than {MOST_SHEET_CELLS:,} cells; {CUT}")


def _read_workbook(content: bytes) -> bytes:
    """Read a workbook's first sheet as text; formulas by stored results (defusedxml refuses entities)."""
    load_workbook = library("openpyxl", "xlsx").load_workbook
    text = io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as bundle:
            _inspect_workbook(bundle)
        opened = load_workbook(
            io.BytesIO(content), read_only=True, data_only=True, keep_links=False
        )
        with warnings.catch_warnings(action="ignore"), closing(opened) as book:
            book.worksheets[0].reset_dimensions()
            for number, row in enumerate(book.worksheets[0].iter_rows(values_only=True)):
                _check_size(number, len(row))
                writer.writerow(row)
    except Refusal:
        raise
    except Exception as error:  # whatever hostile bytes make the libraries raise
        raise Refusal(
            f"not a readable workbook ({type(error).__name__}: {str(error)[:200]}); save the log as CSV"
        ) from error
    return text.getvalue().encode()
