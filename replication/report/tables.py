"""The paper's tables in the paper's shape: headings, rows and columns, and which printed number stands where."""

from dataclasses import dataclass

from replication.report.cells import Cell


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
    columns: tuple[Column, ...]
    row_heading: str = ""
    row_names: tuple[tuple[str, str], ...] = ()
    note: str = ""


@dataclass(frozen=True)
class Row:
    """A row of a table: its heading and, column by column, a cell, a text or nothing."""

    heading: str
    entries: tuple[Cell | str | None, ...]


MEAN_AND_SD = (
    Column("Mean", "mean", "Experimental value of A (rps)"),
    Column("SD", "sd", "Experimental value of A (rps)"),
)
LAYOUTS = (
    Layout(
        "Table 1",
        "Acceptable ranges of the model's parameters",
        (
            Column("Min value", "min"),
            Column("Max value", "max"),
            Column("Units", texts=("rps", "s", "–", "rad/s", "rps", "s", "s", "s", "s")),
        ),
        row_heading="Symbol",
        row_names=(("t_0", "t₀"), ("tau", "τ"), ("omega", "ω"), ("v_t", "v_t"), ("T_1", "T₁"), ("T_2", "T₂")),
        note="t is the time vector of the measured signal v(t)",
    ),
    Layout(
        "Table 2",
        "Results of the experimental evaluation, on artificial datasets with noise, and different values of A",
        (
            Column("Theoretical value of A (rps)", "theoretical"),
            Column("Noise amplitude", "noise"),
            *MEAN_AND_SD,
            Column("Mean relative error (%)", "relative_error"),
        ),
        row_heading="Row",
        row_names=(("11", "11 (no backlash)"),),
        note="The last line is a dataset including just random noise. Values are in rps.",
    ),
    Layout(
        "Table 3",
        "Results of the experimental evaluation, on real-world datasets (test bench)",
        (Column("Known value of A (rps)", "known"), *MEAN_AND_SD, Column("Mean relative error (%)", "relative_error")),
        row_heading="Row",
        note="Each row represents 30 runs of the proposed approach under the same conditions.",
    ),
    Layout(
        "Table 4",
        "Results of the experimental evaluation, on datasets from two robots working in an industrial plant",
        (Column("Affected by excessive backlash", texts=("No", "Yes")), *MEAN_AND_SD),
        row_heading="Robot",
        note="Each row represents 30 runs of the proposed approach under the same conditions.",
    ),
)


def rows(layout: Layout, all_cells: list[Cell]) -> list[Row]:
    """Put an element's cells into its table's rows and columns."""
    own = [cell for cell in all_cells if cell.element == layout.element]
    placed = {(cell.row, cell.column): cell for cell in own}
    names = dict(layout.row_names)
    return [
        Row(
            names.get(row, row),
            tuple(
                column.texts[position] if column.texts else placed.get((row, column.cells)) for column in layout.columns
            ),
        )
        for position, row in enumerate(dict.fromkeys(cell.row for cell in own))
    ]


def groups(layout: Layout) -> list[tuple[str, int]]:
    """The upper line of a table's head: each heading over columns and how many, empty where none."""
    spans: list[tuple[str, int]] = []
    for column in layout.columns:
        if column.over and spans and spans[-1][0] == column.over:
            spans[-1] = (column.over, spans[-1][1] + 1)
        else:
            spans.append((column.over, 1))
    return spans


def column_summary(table: list[Row], position: int, source: str) -> dict[str, int]:
    """Count a column's verdicts from one source."""
    found = [
        judgement.verdict
        for row in table
        if isinstance(entry := row.entries[position], Cell)
        for judgement in entry.judgements
        if judgement.source == source
    ]
    return {verdict: found.count(verdict) for verdict in dict.fromkeys(found)}


def others(all_cells: list[Cell], element: str) -> list[Cell]:
    """Cells of an element that has no table, such as equation 10 and the text."""
    return [cell for cell in all_cells if cell.element == element]
