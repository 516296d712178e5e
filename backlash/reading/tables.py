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
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass

import pandas as pd

from backlash.reading.units import known_unit
from backlash.refusals import Refusal, library

MOST_BYTES = 64 * 2**20  # of a log, packed or not
MOST_CELLS = 8_000_000  # of its table: an hour at 500 Hz of four columns
CUT = "cut it to the test movement, a minute at most"

_HEAD = 2**16  # characters in which the table begins
_TAIL = 50  # lines at the head's end, which show what the rows are like
_LONGEST_NUMBER = 60  # characters
_LEAST_ROWS = 10  # of numbers, that are a table and no part of a header
# Parquet columns that may hold a signal; text and nested ones may unpack to anything.
_NUMERIC = ("int", "uint", "float", "double", "halffloat", "timestamp", "decimal")
_DIALECTS = (
    *((delimiter, mark) for delimiter in "\t;|" for mark in ".,"),
    (",", "."),
    (r"\s+", "."),
    (r"\s+", ","),
)
_LINE_END = re.compile(r"\r\n|\r|\n")
TIME_OF_DAY = re.compile(
    r"(?P<date>[\w./-]{6,11}[T ,]+)?(?P<hour>\d{1,2}):(?P<minute>\d\d):(?P<second>\d\d(?:[.,:]\d+)?)"
    r"\s*(?P<half>[AaPp][Mm])?\s*(?:Z|[+-]\d\d:?\d\d)?"
)
_GROUPED = r"[+-]?\d{1,3}(,\d{3})+\.\d+"  # with marks of thousands
_NUMBER = re.compile(
    rf"{_GROUPED}|[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE
)
_THOUSANDS_OR_DECIMALS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_SPACED_THOUSANDS = re.compile(r"(?<=\d)[\u00a0\u2009\u202f'’](?=\d{3})")
_MISSING = ("", "-", "--", "null", "na", "n/a", "#n/a", "none")


@dataclass(frozen=True, eq=False)
class Sheet:
    """All columns of a file, by name or by number from 1; the index holds the file's rows."""

    frame: pd.DataFrame
    name: str = ""  # of a workbook's sheet, with those that were not read
    header_problem: str = ""  # why the columns of a table with a header have no names


def read_table(content: bytes, least: int = 2) -> Sheet:
    """Read a log's table, of `least` columns of numbers or more."""
    if not content:
        raise Refusal("the file is empty; export the log again")
    if content.startswith(b"PAR1"):
        return Sheet(_read_parquet(content))
    if content.startswith(b"PK"):
        text, name = _workbook_text(content)
        return _read_text(text, name, least)
    return _read_text(decoded(content), "", least)


def check_cells(rows: int, columns: int) -> None:
    """Refuse a table that takes more time and memory than a log is worth."""
    if rows * columns > MOST_CELLS:
        what = f"{rows:,} rows of {columns:,} columns are more than {MOST_CELLS:,} cells"
        raise Refusal(f"{what}; {CUT}, or export time, speed and torque alone")


def _read_parquet(content: bytes) -> pd.DataFrame:
    """Read the numbers of a Parquet file; its other columns are empty."""
    parquet = library("pyarrow.parquet", "parquet")
    arrow = library("pyarrow", "parquet")
    try:
        with parquet.ParquetFile(io.BytesIO(content)) as file:
            fields = [field for field in file.schema_arrow if str(field.type).startswith(_NUMERIC)]
            check_cells(file.metadata.num_rows, len(fields))
            table = file.read(columns=[field.name for field in fields], use_threads=False)
            names = file.schema_arrow.names
        # Decimals would become an object each.
        types = [
            arrow.float64() if arrow.types.is_decimal(field.type) else field.type
            for field in table.schema
        ]
        table = table.cast(arrow.schema(list(zip(table.schema.names, types, strict=True))))
        frame = table.to_pandas(ignore_metadata=True).reindex(columns=names)
    except Refusal:
        raise
    except Exception as error:  # whatever hostile bytes make the library raise
        problem = f"a broken Parquet file ({type(error).__name__}: {str(error)[:200]})"
        raise Refusal(f"{problem}; export the log again, or as CSV") from error
    frame.index = frame.index + 1
    return frame


def _workbook_text(content: bytes) -> tuple[str, str]:
    """The active sheet of a workbook as text, formulas by stored results, and which sheet that is."""
    load_workbook = library("openpyxl", "xlsx").load_workbook
    library("defusedxml", "xlsx")  # refuses entities
    text = io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    cells = 0
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as bundle:
            _check_workbook(bundle)
        opened = load_workbook(
            io.BytesIO(content), read_only=True, data_only=True, keep_links=False
        )
        with warnings.catch_warnings(action="ignore"), closing(opened) as book:
            visible = [each for each in book.worksheets if each.sheet_state == "visible"]
            sheet = book.active if book.active in visible else visible[0]
            sheet.reset_dimensions()
            for row in sheet.iter_rows(values_only=True):
                cells += len(row) + 1
                check_cells(1, cells)
                writer.writerow(row)
            others = ", ".join(repr(each.title) for each in book.worksheets if each is not sheet)
            name = f"{sheet.title!r} (not {others})" if others else ""
    except Refusal:
        raise
    except Exception as error:  # whatever hostile bytes make the libraries raise
        problem = f"not a readable workbook ({type(error).__name__}: {str(error)[:200]})"
        raise Refusal(f"{problem}; save the log as CSV") from error
    return text.getvalue(), name


def _check_workbook(bundle: zipfile.ZipFile) -> None:
    """See that a zip archive is a workbook, and bound what the library would build of it."""
    refused = "a zip archive that is no plain workbook"
    if "xl/workbook.xml" not in bundle.namelist():
        raise Refusal(f"{refused} (it has no xl/workbook.xml); unpack it, or save the log as CSV")
    unpacked = sum(member.file_size for member in bundle.infolist())
    if unpacked > MOST_BYTES:
        size = f"{unpacked / 2**20:,.0f} MiB, above {MOST_BYTES // 2**20}"
        raise Refusal(f"{refused}: its parts unpack to {size}; save the log as CSV")
    for name in bundle.namelist():
        # A cell has four of these, a hostile one a single one.
        if bundle.read(name).count(b"<") > MOST_CELLS // 2:
            raise Refusal(f"{name}: more than {MOST_CELLS // 8:,} cells; {CUT}, or save it as CSV")


def decoded(content: bytes) -> str:
    """A text in an encoding of loggers and spreadsheets, thousands without spaces between."""
    encoding = "utf-8-sig"
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        encoding = "utf-16"
    elif b"\0" in content[:_HEAD] or content.startswith(b"%PDF"):
        raise Refusal(
            "neither text nor .xlsx nor Parquet; export the log as CSV, or hand its columns over from Python"
        )
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:  # Latin-1 takes any bytes
        text = content.decode("utf-16" if encoding == "utf-16" else "latin-1", "replace")
    return _SPACED_THOUSANDS.sub("", text) if _SPACED_THOUSANDS.search(text) else text


def _read_text(text: str, sheet: str, least: int) -> Sheet:
    """Find the table in a text, below its header."""
    head = text[:_HEAD]
    starts = [0, *(end.end() for end in _LINE_END.finditer(head))]
    lines = _LINE_END.split(head)
    if len(text) > _HEAD:
        lines.pop()  # it goes on
        if not lines:
            raise Refusal(f"its first line is longer than {_HEAD} characters; that is no log")
    whole = _joined(lines)
    filled = [(k, line) for k, line in whole if line.strip("#%,;\t \r")]
    if not filled:
        raise Refusal("nothing but blank lines; export the log again")
    delimiter, decimal = _find_dialect([line for _, line in filled[-_TAIL:]], least)
    rows = [(k, _split(line.lstrip("#%").strip(" "), delimiter)) for k, line in filled]
    tail = [fields for _, fields in rows[-_TAIL:]]
    first = _first_row(rows, tail, decimal, least)
    first_line, fields = rows[first]
    _ask_about_commas(tail, decimal)
    check_cells(max(text.count("\n"), text.count("\r")) + 1, len(fields))
    grouped = any(re.fullmatch(_GROUPED, _swap(field, decimal)) for row in tail for field in row)
    try:
        frame = pd.read_csv(
            io.StringIO(text[starts[first_line] :]),
            sep=delimiter,
            decimal=decimal,
            header=None,
            skip_blank_lines=False,
            skipinitialspace=True,
            low_memory=False,
            na_values=["-", "--"],
            thousands={",": ".", ".": ","}[decimal] if grouped else None,
        )
    except (ValueError, pd.errors.ParserError, OverflowError) as error:
        raise Refusal(f"not a table ({error}); export the log again") from error
    width = frame.shape[1]
    used = max(k + 1 for row in tail for k, field in enumerate(row[:width]) if field)
    names, problem = _header_names([fields for _, fields in rows[:first]], used)
    names = [name or str(k + 1) for k, name in enumerate([*names, *[""] * width][:width])]
    count = Counter(names)
    frame.columns = [
        name if count[name] == 1 else f"{name} ({k + 1})" for k, name in enumerate(names)
    ]
    frame.index = frame.index + first_line + 1
    return Sheet(frame, sheet, problem)


def _joined(lines: Sequence[str]) -> list[tuple[int, str]]:
    """Lines with their numbers; one that a quoted cell breaks is joined with the next."""
    whole: list[tuple[int, str]] = []
    for number, line in enumerate(lines):
        if whole and whole[-1][1].count('"') % 2 and line.count('"') % 2:
            start, before = whole.pop()
            whole.append((start, f"{before} {line}"))
        else:
            whole.append((number, line))
    return whole


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == r"\s+":
        return [field.strip('"') for field in line.split()]
    fields = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    return [" ".join(field.split()) for field in fields]


def _swap(field: str, decimal: str) -> str:
    """A number's text with "." as decimal mark."""
    return field.translate(str.maketrans(",.", ".,")) if decimal == "," else field


def _is_number(field: str, decimal: str) -> bool:
    """Whether a field is a number or a time of day."""
    if len(field) > _LONGEST_NUMBER:
        return False
    return bool(_NUMBER.fullmatch(_swap(field, decimal)) or TIME_OF_DAY.fullmatch(field))


def _find_dialect(lines: Sequence[str], least: int) -> tuple[str, str]:
    """Delimiter and decimal mark that read most lines as `least` numbers or more."""

    def score(dialect: tuple[str, str]) -> float:
        delimiter, decimal = dialect
        counts = [
            sum(_is_number(field, decimal) for field in _split(line.lstrip("#%"), delimiter))
            for line in lines
        ]
        enough = sum(count >= least for count in counts)
        return enough + 1e-3 * sum(min(count, 10) for count in counts)

    best = max(_DIALECTS, key=score)
    if score(best) < 1:
        what = f"no rows with two numbers; its last line is {lines[-1].strip()[:60]!r}"
        raise Refusal(f"{what}; export the log again, numbers without units")
    return best


def _first_row(
    rows: Sequence[tuple[int, list[str]]], tail: Sequence[list[str]], decimal: str, least: int
) -> int:
    """The first row of numbers after the last row of names."""
    seen = Counter(
        k for fields in tail for k, field in enumerate(fields) if _is_number(field, decimal)
    )
    numeric = [k for k, count in seen.items() if count > max(seen.values()) / 2]

    def numbers_and_words(fields: Sequence[str]) -> tuple[int, int]:
        cells = [fields[k] for k in numeric if k < len(fields)]
        cells = [cell for cell in cells if cell.lower() not in _MISSING]
        numbers = sum(_is_number(cell, decimal) for cell in cells)
        return numbers, len(cells) - numbers

    counts = [numbers_and_words(fields) for _, fields in rows]
    is_data = [numbers >= least and words == 0 for numbers, words in counts]
    last_names = max((k for k, (n, words) in enumerate(counts) if words and not n), default=-1)
    if sum(is_data[: last_names + 1]) >= _LEAST_ROWS:
        raise Refusal("names in the midst of the numbers; keep one table", row=rows[last_names][0])
    if not any(is_data[last_names + 1 :]):
        raise Refusal("no rows with two numbers below its header; export the log again")
    return is_data.index(True, last_names + 1)


def _ask_about_commas(tail: Sequence[list[str]], decimal: str) -> None:
    """Refuse numbers like 6,001 beside whole ones."""
    if decimal != ",":
        return
    numbers = [field for row in tail for field in row if _is_number(field, decimal)]
    marked = [field for field in numbers if "," in field]
    whole = [field for field in numbers if field.isdigit()]
    if marked and whole and all(_THOUSANDS_OR_DECIMALS.fullmatch(field) for field in marked):
        as_decimal = marked[0].replace(",", ".")
        what = f"{marked[0]!r} may be {marked[0].replace(',', '')} or {as_decimal}"
        raise Refusal(f"{what}; export numbers without marks of thousands")


def _header_names(above: Sequence[Sequence[str]], used: int) -> tuple[list[str], str]:
    """Names of the columns that hold anything, from the rows above the numbers, or why there are none.

    A row of units goes to the row of names above it.
    """
    rows = [list(row) for row in above]
    for row in rows:
        while row and not row[-1]:
            row.pop()
    if not rows:
        return [], ""
    names = rows[-1]
    units = [unit.strip("[]()<> ") for unit in names]
    if len(rows) > 1 and sum(bool(known_unit(unit)) for unit in units) >= len(units) / 2:
        units += [""] * (len(rows[-2]) - len(units))
        if len(units) == len(rows[-2]):
            names = [
                f"{name} [{unit}]" if unit else name
                for name, unit in zip(rows[-2], units, strict=True)
            ]
    if len(names) == used + 1 and names[-1].lower() == "comment":  # as LabVIEW writes
        names = names[:-1]
    if len(names) != used:
        return [], f"its header has {len(names)} fields, its rows have {used}"
    return names, ""
