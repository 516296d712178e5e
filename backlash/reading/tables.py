"""From a log's bytes to a table of columns: text, XLSX and Parquet.

Log files are untrusted input: their kind is told by content, and two limits bound them, bytes and
cells.
"""

import csv
import io
import re
import warnings
import zipfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import accumulate, zip_longest
from typing import TypeAlias

import pandas as pd

from backlash.reading.units import KNOWN, known_unit, words_of
from backlash.refusals import Refusal, library

MOST_BYTES = 64 * 2**20  # of a log, packed or not
MOST_CELLS = 8_000_000  # of its table: an hour at 500 Hz of four columns
CUT = "cut it to the test movement, a minute at most"

_HEAD = 2**16  # characters in which the table begins
_TAIL = 50  # rows at the head's end, which show what the others are like
_LEAST_ROWS = 10  # of numbers, that are a table and no part of a header
# Parquet columns that may hold a signal; text and nested ones may unpack to anything.
_NUMERIC = ("int", "uint", "float", "double", "halffloat", "timestamp", "duration", "decimal")
_SWAPPED = str.maketrans(",.", ".,")  # for decimal commas
# Delimiters, and whether the decimal mark is a comma.
_DIALECTS = (*((mark, swapped) for swapped in (False, True) for mark in "\t;| "), (",", False))
TIME_OF_DAY = re.compile(
    r"(?:[\w./,-]{6,11}[T ,]+)?(?P<clock>\d{1,2}:\d\d:\d\d)(?:[.,:](?P<fraction>\d+))?"
    r"\s*(?P<half>[AaPp][Mm])?\s*(?:Z|[+-]\d\d:?\d\d)?"
)
_THOUSANDS_OR_DECIMALS = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}")
_SPACED_THOUSANDS = re.compile(r"(?<=\d)[\u00a0\u2009\u202f'’](?=\d{3})")
_MISSING = ("", "-", "--", "null", "na", "n/a", "#n/a", "none")

# The line of a text on which a row begins, and its cells.
_Row: TypeAlias = tuple[int, list[str]]


@dataclass(frozen=True, eq=False)
class Table:
    """All columns of a log, by name or by number from 1; the index holds the file's rows."""

    frame: pd.DataFrame
    sheet: str = ""  # of a workbook, with those that were not read
    file: str = ""  # what the log is called in its answer
    sha256: str | None = None  # of the file's bytes


def read_table(content: bytes, least: int = 2) -> Table:
    """Read a log's table, of `least` columns of numbers or more."""
    if not content:
        raise Refusal("the file is empty; export the log again")
    name = ""
    try:
        if content.startswith(b"PAR1"):
            return Table(_read_parquet(content))
        if content.startswith(b"PK\3\4"):
            text, name = _workbook_text(content)
        else:
            text = decoded(content)
    except Refusal:
        raise
    except Exception as error:  # whatever hostile bytes make the libraries raise
        problem = f"no readable workbook or Parquet file ({type(error).__name__}: {error!s:.200})"
        raise Refusal(f"{problem}; save the log as CSV") from error
    return _read_text(text, name, least)


def check_cells(cells: int) -> None:
    """Refuse a table that takes more time and memory than a log is worth."""
    if cells > MOST_CELLS:
        raise Refusal(f"more than {MOST_CELLS:,} cells; {CUT}, or export fewer columns")


def _read_parquet(content: bytes) -> pd.DataFrame:
    """Read the numbers of a Parquet file; its other columns are empty."""
    parquet = library("pyarrow.parquet", "parquet")
    with parquet.ParquetFile(io.BytesIO(content)) as file:
        schema = file.schema_arrow
        numeric = [field.name for field in schema if str(field.type).startswith(_NUMERIC)]
        check_cells(file.metadata.num_rows * len(numeric))
        table = file.read(columns=numeric, use_threads=False)
    frame = table.to_pandas(ignore_metadata=True).reindex(columns=schema.names)
    frame.index = frame.index + 1
    return frame


def _workbook_text(content: bytes) -> tuple[str, str]:
    """The active sheet of a workbook as text, formulas by stored results, and which sheet that is."""
    load_workbook = library("openpyxl", "xlsx").load_workbook
    library("defusedxml", "xlsx")  # refuses entities
    with zipfile.ZipFile(io.BytesIO(content)) as bundle:
        if sum(member.file_size for member in bundle.infolist()) > MOST_BYTES:
            raise Refusal(f"it unpacks to more than {MOST_BYTES // 2**20} MiB; {CUT}")
        for name in bundle.namelist():  # a cell has four signs, a hostile one a single one
            check_cells(bundle.read(name).count(b"<") // 4)
    opened = load_workbook(io.BytesIO(content), read_only=True, data_only=True, keep_links=False)
    text = io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    cells = 0
    with warnings.catch_warnings(action="ignore"), closing(opened) as book:
        visible = [each for each in book.worksheets if each.sheet_state == "visible"]
        sheet = book.active if book.active in visible else visible[0]
        sheet.reset_dimensions()
        for row in sheet.iter_rows(values_only=True):
            cells += len(row) + 1
            check_cells(cells)
            writer.writerow(row)
        others = ", ".join(repr(each.title) for each in book.worksheets if each is not sheet)
    return text.getvalue(), f"{sheet.title!r} (not {others})" if others else ""


def decoded(content: bytes) -> str:
    """A text in an encoding of loggers and spreadsheets, thousands without spaces between."""
    encoding = "utf-8-sig"
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        encoding = "utf-16"
    elif b"\0" in content[:_HEAD]:
        raise Refusal(
            "neither text nor .xlsx nor Parquet; export the log as CSV, or hand its columns over from Python"
        )
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:  # Latin-1 takes any bytes
        text = content.decode("utf-16" if encoding == "utf-16" else "latin-1", "replace")
    return _SPACED_THOUSANDS.sub("", text.replace("\r\n", "\n").replace("\r", "\n"))


def _read_text(text: str, sheet: str, least: int) -> Table:
    """Find the table in a text, below its header."""
    head = text[:_HEAD]
    if len(text) > _HEAD:
        head = head[: head.rfind("\n") + 1]  # the last line goes on
    delimiter, is_swapped = _find_dialect(head, least)
    marks = _SWAPPED if is_swapped else {}
    rows = _rows(head.translate(marks), delimiter)
    if is_swapped:
        _ask_about_commas(rows)
        text = text.translate(_SWAPPED)
    first = _first_row(rows, least)
    first_line = rows[first][0]
    check_cells((text.count("\n") + 1) * len(rows[first][1]))
    try:
        frame = pd.read_csv(
            io.StringIO(text.split("\n", first_line)[-1]),
            sep=r"\s+" if delimiter == " " else delimiter,
            header=None,
            skip_blank_lines=False,
            skipinitialspace=True,
            low_memory=False,
            na_values=["-", "--"],
        )
    except (ValueError, pd.errors.ParserError, OverflowError) as error:
        raise Refusal(f"not a table ({error}); export the log again") from error
    width = frame.shape[1]
    used = max(k + 1 for _, cells in rows[-_TAIL:] for k, cell in enumerate(cells[:width]) if cell)
    above = [[cell.translate(marks) for cell in cells] for _, cells in rows[:first]]
    names = _header_names(above, used)
    names = [name or str(k + 1) for k, name in enumerate([*names, *[""] * width][:width])]
    count = Counter(names)
    frame.columns = [
        name if count[name] == 1 else f"{name} ({k + 1})" for k, name in enumerate(names)
    ]
    frame.index = frame.index + first_line + 1
    return Table(frame, sheet)


def _rows(text: str, delimiter: str) -> list[_Row]:
    """Rows that are not blank, without signs of comments before them."""
    lines = (line.lstrip("#% ") for line in io.StringIO(text))
    if delimiter == " ":
        lines = (" ".join(line.split()) for line in lines)
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=delimiter != " ")
    rows = []
    start = 0
    for fields in reader:
        cells = [" ".join(field.split()) for field in fields]
        if any(cells):
            rows.append((start, cells))
        start = reader.line_num
    return rows


def _is_number(cell: str) -> bool:
    """Whether a cell is a number or a time of day."""
    try:
        float(cell)
    except ValueError:
        return bool(TIME_OF_DAY.fullmatch(cell))
    return True


def _find_dialect(head: str, least: int) -> tuple[str, bool]:
    """Delimiter, and whether the decimal mark is a comma, that read most of the last rows as numbers."""
    tail = "\n".join(head.strip("\n").split("\n")[-_TAIL:])
    best = (0, 0)
    dialect = "", False
    for delimiter, is_swapped in _DIALECTS:
        rows = _rows(tail.translate(_SWAPPED) if is_swapped else tail, delimiter)
        counts = [(sum(map(_is_number, cells)), sum(map(bool, cells))) for _, cells in rows]
        enough = sum(numbers >= least for numbers, _ in counts)
        score = enough, sum(2 * numbers - filled for numbers, filled in counts)
        if score > best:
            best, dialect = score, (delimiter, is_swapped)
    if best[0] == 0:
        last = tail.strip("#%,;\t \n").rpartition("\n")[2]
        if not last:
            raise Refusal(f"nothing but blanks, or a first line above {_HEAD} characters")
        what = f"no rows with two numbers; its last line is {last.strip()[:60]!r}"
        raise Refusal(f"{what}; export it again, numbers without units and marks of thousands")
    return dialect


def _first_row(rows: Sequence[_Row], least: int) -> int:
    """The first row of numbers after the last row of names."""
    seen = Counter(
        k for _, cells in rows[-_TAIL:] for k, cell in enumerate(cells) if _is_number(cell)
    )
    numeric = [k for k, count in seen.items() if count > max(seen.values()) / 2]
    is_data = []
    is_names = []
    for _, cells in rows:
        filled = [cells[k] for k in numeric if k < len(cells) and cells[k].lower() not in _MISSING]
        numbers = sum(map(_is_number, filled))
        is_data.append(least <= numbers == len(filled))
        is_names.append(numbers == 0 < len(filled))
    below = len(rows) - is_names[::-1].index(True) if True in is_names else 0
    if sum(is_data[:below]) >= _LEAST_ROWS:
        raise Refusal("names in the midst of the numbers; keep one table", row=rows[below - 1][0])
    if True not in is_data[below:]:
        raise Refusal("no rows with two numbers below its header; export the log again")
    return is_data.index(True, below)


def _ask_about_commas(rows: Sequence[_Row]) -> None:
    """Refuse numbers like 6,001 beside whole ones; here their commas are points."""
    numbers = [cell for _, cells in rows[-_TAIL:] for cell in cells if _is_number(cell)]
    marked = [cell for cell in numbers if "." in cell]
    is_any_whole = any(cell.isdigit() for cell in numbers)
    if marked and is_any_whole and all(map(_THOUSANDS_OR_DECIMALS.fullmatch, marked)):
        what = f"{marked[0].replace('.', ',')!r} may be {marked[0].replace('.', '')} or {marked[0]}"
        raise Refusal(f"{what}; export numbers without marks of thousands")


def _are_units(cells: Sequence[str]) -> bool:
    """Whether cells hold units, and no names."""
    names = {name for names in KNOWN["names"].values() for name in names if len(name) > 1}
    units = [known_unit(cell.strip("[]()<> ")) for cell in cells]
    named = [unit or cell.lower() not in names for unit, cell in zip(units, cells, strict=True)]
    return any(units) and all(named)


def _header_names(above: Sequence[Sequence[str]], used: int) -> list[str]:
    """Names of the columns that hold anything, from the rows above the numbers.

    A row of units goes to the row of names above it, and what merged cells say of motor and joint to those below them.
    """
    rows = [list(row) for row in above]
    for row in rows:
        while not row[-1]:
            row.pop()
    if not rows:
        return []
    names = rows.pop()
    if rows and len(rows[-1]) >= len(names) and _are_units(names):
        units = [unit.strip("[]()<> ") for unit in names]
        pairs = zip_longest(rows.pop(), units, fillvalue="")
        names = [f"{name} [{unit}]".strip() if unit else name for name, unit in pairs]
    telling = {*KNOWN["sides"]["motor"], *KNOWN["sides"]["link"], *KNOWN["no_measurement"]}
    is_over_all = rows and ("" in rows[-1] or len(rows[-1]) == len(names))
    if is_over_all and words_of(" ".join(rows[-1])) & telling:
        merged: Iterator[str] = accumulate(rows[-1], lambda left, own: own or left)
        pairs = zip_longest(merged, names, fillvalue=rows[-1][-1])
        names = [f"{group} {name}".strip() for group, name in pairs]
    if len(names) == used + 1 and names[-1].lower() == "comment":  # as LabVIEW writes
        names = names[:-1]
    if len(names) != used:
        what = f"its header has {len(names)} fields, its rows have {used}"
        raise Refusal(f"{what}; mend the header, or leave it out and give columns by number")
    return names
