"""The README's blocks, made from the results and from `data/map.csv`."""

from pathlib import Path

import pandas as pd

from replication import published, workbook
from replication.workbook import files, judging


def status(results: Path) -> str:
    """Make the README's status block: verdicts by element and source."""
    counts = judging.verdict_counts(judging.verdicts(results)).reset_index()
    total = counts.drop(columns=["element", "source"]).sum()
    summary = ", ".join(f"{number} {verdict}" for verdict, number in total.items())
    return f"{summary} (cells by source):\n\n{_markdown(counts)}"


def paper_map() -> str:
    """Make the README's block that maps the paper to notebooks, functions and tests."""
    table = published.paper_map()
    number = {source.stem: source.stem[:2].lstrip("0") for source in (workbook.ROOT / "notebooks").glob("[0-9]*.py")}
    shown = pd.DataFrame(
        {
            "paper": table["element"],
            "what": table["what"],
            "notebook": [
                ", ".join(f"[{number[name]}](notebooks/{name}.ipynb)" for name in names.split())
                for names in table["notebooks"]
            ],
            "function": [", ".join(f"`{name}`" for name in names.split()) for names in table["functions"]],
            "test": [_test_link(test) for test in table["test"]],
            "note": table["note"],
        }
    )
    return _markdown(shown)


def _test_link(test: str) -> str:
    file, _, name = test.partition("::")
    return f"[{name.removeprefix('test_').replace('_', ' ')}]({file})" if name else ""


def _markdown(table: pd.DataFrame) -> str:
    lines = ["| " + " | ".join(table.columns) + " |", "|" + "---|" * len(table.columns)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in table.itertuples(index=False)]
    return "\n".join(lines)


def block(text: str, name: str) -> str:
    """Find a block of the README between its marks.

    Raises
    ------
    ValueError
        The marks are missing.
    """
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    if begin not in text or end not in text:
        raise ValueError(f"the marks {begin} and {end} are missing")
    return text.split(begin, 1)[1].split(end, 1)[0]


def update_readme(readme: Path, results: Path) -> None:
    """Replace the README's blocks with what the results and `data/map.csv` say.

    Raises
    ------
    ValueError
        The README lacks the marks of a block.
    """
    text = readme.read_text(encoding="utf-8")
    for name, content in (("status", status(results)), ("map", paper_map())):
        old = block(text, name)
        marks = f"<!-- {name}: begin -->{old}", f"<!-- {name}: begin -->\n{content}\n"
        text = text.replace(*marks)
    files.write_text(readme, text)
