"""Workbooks and Parquet files, which a few bytes can make large: their sizes are checked before they are unpacked."""

import csv
import io
import re
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import pandas as pd

from backlash.reading import limits
from backlash.refusals import Refusal, library

PARQUET = b"PAR1"  # a file's first bytes
_ADVICE = "cut it to the test movement, a minute at most"
_SHEET = re.compile(r"(.*/)?(worksheets/[^/]+|sharedStrings)\.xml", re.IGNORECASE)
_BEFORE_ROW = re.compile(rb"(?=<(?:\w+:)?row\b)")


def check_bytes(size: int) -> None:
    """Refuse a file, or what it unpacks to, that is too large."""
    if size > limits.MOST_BYTES:
        raise Refusal(f"more than {limits.MOST_BYTES // 2**20} MiB, packed or not; {_ADVICE}")


def check_size(rows: int, columns: int) -> None:
    """Refuse a table that takes more time and memory than a log is worth."""
    if columns > limits.MOST_COLUMNS:
        raise Refusal(
            f"{columns:,} columns, more than {limits.MOST_COLUMNS:,}; export those of time, speed and torque"
        )
    if rows * columns > limits.MOST_CELLS:
        raise Refusal(f"more than {limits.MOST_CELLS:,} cells; {_ADVICE}, or export fewer columns")


@contextmanager
def _unpacking() -> Iterator[None]:
    """Refuse what hostile bytes make the libraries raise."""
    try:
        yield
    except Refusal:
        raise
    except Exception as error:
        raise Refusal(
            f"no readable workbook or Parquet file ({type(error).__name__}: {error!s:.200}); "
            "save the log as CSV"
        ) from error


def read_parquet(content: bytes) -> pd.DataFrame:
    """Read a Parquet table, of whose texts a few bytes may repeat a long one, some rows at a time."""
    parquet, pyarrow = library("pyarrow.parquet", "parquet"), library("pyarrow", "parquet")
    batches = []
    size = 0
    with _unpacking(), parquet.ParquetFile(io.BytesIO(content)) as file:
        check_size(file.metadata.num_rows, len(file.schema_arrow))
        for batch in file.iter_batches(64):
            size += batch.nbytes
            check_bytes(size)
            batches.append(batch)
        table = pyarrow.Table.from_batches(batches, file.schema_arrow)
        frame = table.to_pandas(ignore_metadata=True)
    frame.index += 1
    return frame


def workbook_text(content: bytes) -> tuple[str, str]:
    """The active sheet of a workbook as text, formulas by stored results, and which sheet that is."""
    load_workbook = library("openpyxl", "xlsx").load_workbook
    library("defusedxml", "xlsx")  # refuses entities
    with _unpacking():
        _check_parts(content)
        opened = load_workbook(
            io.BytesIO(content), read_only=True, data_only=True, keep_links=False
        )
        with warnings.catch_warnings(action="ignore"), closing(opened) as book:
            return _sheet_text(book)


def _check_parts(content: bytes) -> None:
    """Refuse a workbook whose parts unpack to more than is worth reading.

    Styles and relations become objects a hundred times as large, sheets and texts are read one by one.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as bundle:
        check_bytes(sum(part.file_size for part in bundle.infolist()))
        tags = 0
        for name in bundle.namelist():
            part = bundle.read(name)
            if _SHEET.fullmatch(name):
                for row in _BEFORE_ROW.split(part)[1:]:
                    # A cell has four signs, a hostile one a single one.
                    check_size(1, row.count(b"<") // 8)
            elif name.endswith((".xml", ".rels")):
                tags += part.count(b"<")
        if tags > limits.MOST_STYLE_TAGS:
            raise Refusal(f"its styles and relations have {tags:,} entries; save the log as CSV")


def _sheet_text(book: Any) -> tuple[str, str]:
    text = io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    cells = 0
    visible = [each for each in book.worksheets if each.sheet_state == "visible"]
    sheet = book.active if book.active in visible else visible[0]
    sheet.reset_dimensions()
    for row in sheet.iter_rows(values_only=True):
        cells += len(row) + 1
        check_size(cells, 1)
        writer.writerow(row)
    others = ", ".join(repr(each.title) for each in book.worksheets if each is not sheet)
    return text.getvalue(), f"{sheet.title!r} (not {others})" if others else ""
