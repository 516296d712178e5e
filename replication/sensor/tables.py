"""From a log file to a table of columns: CSV, Parquet and XLSX.

Log files are untrusted input: their kind is told by content, and size and archive headers are verified.
"""

import io
import re
import warnings
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from stat import S_ISDIR, S_ISREG

import numpy as np
import pandas as pd

# An hour at 500 Hz is 1.8 million rows, and a log needs some 5 s of it.
MOST_ROWS = 2_000_000
MOST_BYTES = 64 * 2**20
MOST_COLUMNS = 64
# What a workbook of that size may unpack to; its XML takes some 100 bytes a cell.
MOST_UNPACKED_BYTES = 512 * 2**20
MOST_ZIP_MEMBERS = 1000
_LONGEST_LINE = 2**16

_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d([.,]\d+)?)?(Z|[+-]\d\d:?\d\d)?")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_UNIT_WORD = re.compile(r"[\[(<]?\s*[A-Za-z°µ%/.^\-0-9]{0,8}\s*[\])>]?")


class UnusableLog(ValueError):
    """A file that no answer can be had from; the message is one line: what is wrong, where, what to do."""

    exit_status = 2

    def __init__(self, message: str):
        super().__init__(" ".join(message.split()))


def read_table(path: Path) -> pd.DataFrame:
    """Columns of a CSV, Parquet or XLSX file by name, or from 1 without a header; the index is the file's row."""
    try:
        return {"parquet": _read_parquet, "workbook": _read_workbook, "text": _read_text}[_kind(path)](path)
    except FileNotFoundError as error:
        raise UnusableLog(f"{path}: no such file; check the name") from error
    except PermissionError as error:
        raise UnusableLog(f"{path}: no permission to read it; ask its owner for it") from error
    except OSError as error:
        raise UnusableLog(f"{path}: cannot be read ({error.strerror or error}); check the file") from error
    except MemoryError as error:
        raise UnusableLog(f"{path}: too large for this machine's memory; cut it to the test movement") from error


def _kind(path: Path) -> str:
    """Tell a file's kind from its first bytes, having checked that it is one."""
    try:
        status = path.stat()
    except ValueError as error:  # a name that no file can have
        raise UnusableLog(f"{path}: cannot be read ({error}); check the name") from error
    if S_ISDIR(status.st_mode):
        raise UnusableLog(f"{path}: a folder where a log file is needed; name a file in it")
    if not S_ISREG(status.st_mode):
        raise UnusableLog(f"{path}: not a regular file; copy the log into one")
    if status.st_size == 0:
        raise UnusableLog(f"{path}: the file is empty; export the log again")
    with path.open("rb") as file:
        head = file.read(_LONGEST_LINE)
    if head.startswith(b"PAR1"):
        return "parquet"
    if status.st_size > MOST_BYTES:
        raise UnusableLog(
            f"{path}: {status.st_size / 2**20:.0f} MiB, above the {MOST_BYTES // 2**20} MiB that are read; "
            "cut it to the test movement, a minute at most"
        )
    for magic, what in (
        (b"\xd0\xcf\x11\xe0", "an old Excel file, which may hold macros; save it as .xlsx or CSV"),
        (b"\x1f\x8b", "compressed; unpack it first"),
        (b"%PDF", "a PDF; export the log as CSV"),
    ):
        if head.startswith(magic):
            raise UnusableLog(f"{path}: {what}")
    if head.startswith(b"PK"):
        return "workbook"
    if b"\0" in head and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise UnusableLog(f"{path}: neither text nor Parquet nor a workbook; export the log as CSV")
    return "text"


# ---------------------------------------------------------------------------------------------------------------
# Text


def _decoded(content: bytes) -> str:
    """Decode text as spreadsheets and loggers write it; Latin-1, which takes any bytes, comes last."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _is_number(field: str, decimal: str) -> bool:
    field = field.strip().strip('"')
    return bool(_NUMBER.fullmatch(field.replace(decimal, ".") if decimal != "." else field) or _DATE.fullmatch(field))


def _split(line: str, delimiter: str) -> list[str]:
    return line.split() if delimiter == r"\s+" else [field.strip() for field in line.split(delimiter)]


def _dialect(lines: Sequence[str]) -> tuple[str, str] | None:
    """Delimiter and decimal mark that read most lines as two numbers or more; None if no lines are read so."""
    best, most = None, 0.0
    for delimiter, decimal in (*((d, m) for d in "\t;|" for m in ".,"), (",", "."), (r"\s+", "."), (r"\s+", ",")):
        read = [sum(_is_number(field, decimal) for field in _split(line, delimiter)) for line in lines]
        score = sum(count >= 2 for count in read) + 1e-3 * sum(min(count, 10) for count in read)
        if score > most and max(read) >= 2:
            best, most = (delimiter, decimal), score
    return best


def _header_names(rows: Sequence[Sequence[str]], columns: int) -> list[str]:
    """Names of the columns from the rows above the numbers; a row of units goes to the row of names above it."""
    fitting = [[str(field).strip().strip('"') for field in row] for row in rows if len(row) == columns]
    if not fitting:
        return [str(number + 1) for number in range(columns)]
    names = fitting[-1]
    if len(fitting) > 1 and all(_UNIT_WORD.fullmatch(field) for field in names):
        above = fitting[-2]
        if any(len(field) > len(unit.strip("[]()")) for field, unit in zip(above, names, strict=True)):
            names = [f"{field} [{unit.strip('[]()')}]" for field, unit in zip(above, names, strict=True)]
    return [name or str(number + 1) for number, name in enumerate(names)]


def _read_text(path: Path) -> pd.DataFrame:
    text = _decoded(path.read_bytes())
    head = re.split(r"\r\n|\r|\n", text[:_LONGEST_LINE])[:400]
    if len(head) < 2 and len(text) >= _LONGEST_LINE:
        raise UnusableLog(f"{path}: its first line is longer than {_LONGEST_LINE} characters; that is no log")
    filled = [(number, line.lstrip("#").strip()) for number, line in enumerate(head) if line.strip("#,;\t \r")]
    if not filled:
        raise UnusableLog(f"{path}: nothing but blank lines; export the log again")
    dialect = _dialect([line for _, line in filled[-50:]])
    if dialect is None:
        raise UnusableLog(f"{path}: no rows with two numbers (header only, or no table); export the log again")
    delimiter, decimal = dialect
    first = next(
        number for number, line in filled if sum(_is_number(field, decimal) for field in _split(line, delimiter)) >= 2
    )
    above = [_split(line, delimiter) for number, line in filled if number < first]
    try:
        frame = pd.read_csv(
            io.StringIO(text), sep=delimiter, decimal=decimal, header=None, skiprows=first, nrows=MOST_ROWS + 1,
            skip_blank_lines=False, skipinitialspace=True, low_memory=False,
        )  # fmt: skip
    except (ValueError, pd.errors.ParserError, OverflowError) as error:
        raise UnusableLog(f"{path}: not a table ({error}); export the log again") from error
    frame.index = frame.index + first + 1
    return _checked(frame, above, path)


def _checked(frame: pd.DataFrame, above: Sequence[Sequence[str]], path: Path) -> pd.DataFrame:
    """Name the columns, drop blank rows and columns, and keep to the limits."""
    if len(frame) > MOST_ROWS:
        raise UnusableLog(f"{path}: more than {MOST_ROWS:,} rows; cut it to the test movement, a minute at most")
    if frame.shape[1] > MOST_COLUMNS:
        raise UnusableLog(f"{path}: more than {MOST_COLUMNS} columns; export time and speed alone")
    names = _header_names(above, frame.shape[1])
    frame.columns = [name if names.count(name) == 1 else f"{name} ({k + 1})" for k, name in enumerate(names)]
    return frame.dropna(how="all").dropna(how="all", axis=1)


# ---------------------------------------------------------------------------------------------------------------
# Parquet


def _read_parquet(path: Path) -> pd.DataFrame:
    try:
        from pyarrow import ArrowException
        from pyarrow.parquet import ParquetFile
    except ImportError as error:
        raise UnusableLog(
            f"{path}: reading Parquet needs pyarrow; pip install 'backlash-replication[fleet]', or export CSV"
        ) from error
    try:
        with ParquetFile(path) as file:
            rows, schema = file.metadata.num_rows, file.schema_arrow
            if rows > MOST_ROWS:
                raise UnusableLog(f"{path}: {rows:,} rows, above the {MOST_ROWS:,} that are read; cut it")
            # Text and nested columns hold no speed, and may unpack to anything.
            flat = [field.name for field in schema if str(field.type).startswith(("int", "uint", "float", "double",
                    "halffloat", "timestamp", "decimal"))]  # fmt: skip
            if len(flat) > MOST_COLUMNS:
                raise UnusableLog(f"{path}: more than {MOST_COLUMNS} columns; export time and speed alone")
            if len(set(flat)) != len(flat):
                raise UnusableLog(f"{path}: two columns have one name; export the log again")
            frame = file.read(columns=flat).to_pandas(ignore_metadata=True)
    except (ArrowException, ValueError, TypeError, OverflowError) as error:
        if isinstance(error, UnusableLog):
            raise
        raise UnusableLog(f"{path}: a broken Parquet file ({error}); export the log again") from error
    frame.index = np.arange(1, len(frame) + 1)
    return frame


# ---------------------------------------------------------------------------------------------------------------
# Workbooks


def _inspect_workbook(path: Path) -> None:
    """See by its directory that a workbook is one, without macros and not too large; no part unpacks to more."""
    refused = f"{path}: a zip archive that is no plain workbook"
    with zipfile.ZipFile(path) as bundle:
        members = bundle.infolist()
        names = {member.filename for member in members}
        if "xl/workbook.xml" not in names:
            raise UnusableLog(f"{refused} (it has no xl/workbook.xml); unpack it, or save the log as CSV")
        declared = sum(member.file_size for member in members)
        if len(members) > MOST_ZIP_MEMBERS or declared > MOST_UNPACKED_BYTES:
            raise UnusableLog(
                f"{refused}: {len(members)} parts that unpack to {declared / 2**20:,.0f} MiB, above "
                f"{MOST_UNPACKED_BYTES // 2**20}; save the test movement alone, as CSV"
            )
        macros = any(name.lower().endswith("vbaproject.bin") for name in names)
        if macros or b"macroEnabled" in bundle.read("[Content_Types].xml"):
            raise UnusableLog(f"{path}: a workbook with macros; save it as .xlsx without them")


def _workbook_rows(path: Path) -> list[tuple]:
    """Rows of a workbook's first sheet, blank ones too; formulas by stored results (defusedxml refuses entities)."""
    from openpyxl import load_workbook

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        book = load_workbook(path, read_only=True, data_only=True, keep_links=False)
        try:
            sheet, rows = book.worksheets[0], []
            sheet.reset_dimensions()
            for row in sheet.iter_rows(values_only=True):
                if len(row) > MOST_COLUMNS or len(rows) > MOST_ROWS:
                    raise UnusableLog(f"{path}: more than {MOST_COLUMNS} columns or {MOST_ROWS:,} rows; cut it")
                rows.append(row)
            return rows
        finally:
            book.close()


def _read_workbook(path: Path) -> pd.DataFrame:
    try:
        _inspect_workbook(path)
        rows = _workbook_rows(path)
    except UnusableLog:
        raise
    except OSError as error:
        raise UnusableLog(f"{path}: not a readable workbook ({error}); save the log as CSV") from error
    except Exception as error:  # whatever hostile bytes make zipfile, the XML parser or openpyxl raise
        raise UnusableLog(
            f"{path}: not a readable workbook ({type(error).__name__}: {error}); save the log as CSV"
        ) from error
    numeric = [k for k, row in enumerate(rows) if _numbers_in(row) >= 2]
    if not numeric:
        raise UnusableLog(f"{path}: no rows with two numbers in its first sheet; export the log again")
    first = numeric[0]
    width = max(len(row) for row in rows[first:])
    above = [["" if cell is None else cell for cell in row] for row in rows[:first]]
    above = [[*row, *[""] * (width - len(row))] for row in above if any(str(cell) for cell in row)]
    frame = pd.DataFrame([(*row, *[None] * (width - len(row))) for row in rows[first:]])
    frame.index = frame.index + first + 1
    return _checked(frame, above, path)


def _numbers_in(row: Iterable) -> int:
    return sum((isinstance(cell, int | float) and not isinstance(cell, bool)) or hasattr(cell, "year") for cell in row)
