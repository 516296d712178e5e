"""The paper's tables in the paper's shape: headings, rows and columns, and which printed number stands where."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from workbook.report.cells import SOURCES, Cell

Entry = Cell | str


@dataclass(frozen=True)
class Column:
    """A column: its heading, the heading over it and its neighbours, and the cells' column or a fixed text a row."""

    heading: str
    cells: str = ""
    over: str = ""
    texts: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layout:
    """A table's caption and columns as the paper has them, the rows' headings, and the paper's note."""

    element: str
    caption: str
    row_heading: str
    columns: tuple[Column, ...]
    row_names: tuple[tuple[str, str], ...] = ()
    note: str = ""

    def rows(self, cells: dict[str, Cell]) -> list[tuple[str, list[Entry]]]:
        """The table's rows: each a heading and, column by column, a cell or a text."""
        placed = {(cell.row, cell.column): cell for cell in cells.values() if cell.element == self.element}
        names = dict(self.row_names)
        rows = []
        for place, row in enumerate(dict.fromkeys(row for row, _ in placed)):
            entries = [c.texts[place] if c.texts else placed.get((row, c.cells), "–") for c in self.columns]
            rows.append((names.get(row, row), entries))
        return rows

    @property
    def groups(self) -> list[tuple[str, int]]:
        """The upper line of the head: each heading over columns and over how many, empty where there is none."""
        return [(over, len(list(part))) for over, part in groupby(column.over for column in self.columns)]

    def count_verdicts(self, cells: dict[str, Cell]) -> dict[str, list[Counter[str]]]:
        """Each column's verdicts, counted for each source that judges the table."""
        columns = list(zip(*(entries for _, entries in self.rows(cells)), strict=True))
        counted = {source: [_count_verdicts(column, source) for column in columns] for source in SOURCES}
        return {source: counts for source, counts in counted.items() if any(counts)}


def _count_verdicts(column: Sequence[Entry], source: str) -> Counter[str]:
    judgements = [each for entry in column if isinstance(entry, Cell) for each in entry.judgements]
    return Counter(each.verdict for each in judgements if each.source == source)


THIRTY_RUNS = "Each row represents 30 runs of the proposed approach under the same conditions."
MEAN_AND_SD = tuple(Column(name, name.lower(), "Experimental value of A (rps)") for name in ("Mean", "SD"))
RELATIVE_ERROR = Column("Mean relative error (%)", "relative_error")
LAYOUTS = (
    Layout(
        "Table 1",
        "Acceptable ranges of the model's parameters",
        "Symbol",
        (
            Column("Min value", "min"),
            Column("Max value", "max"),
            Column("Units", texts=("rps", "s", "–", "rad/s", "rps", "s", "s", "s", "s")),
        ),
        row_names=(("t_0", "t₀"), ("tau", "τ"), ("omega", "ω"), ("v_t", "v_t"), ("T_1", "T₁"), ("T_2", "T₂")),
        note="t is the time vector of the measured signal v(t)",
    ),
    Layout(
        "Table 2",
        "Results of the experimental evaluation, on artificial datasets with noise, and different values of A",
        "Row",
        (
            Column("Theoretical value of A (rps)", "theoretical"),
            Column("Noise amplitude", "noise"),
            *MEAN_AND_SD,
            RELATIVE_ERROR,
        ),
        row_names=(("11", "11 (no backlash)"),),
        note="The last line is a dataset including just random noise. Values are in rps.",
    ),
    Layout(
        "Table 3",
        "Results of the experimental evaluation, on real-world datasets (test bench)",
        "Row",
        (Column("Known value of A (rps)", "known"), *MEAN_AND_SD, RELATIVE_ERROR),
        note=THIRTY_RUNS,
    ),
    Layout(
        "Table 4",
        "Results of the experimental evaluation, on datasets from two robots working in an industrial plant",
        "Robot",
        (Column("Affected by excessive backlash", texts=("No", "Yes")), *MEAN_AND_SD),
        note=THIRTY_RUNS,
    ),
)
