"""What the head of a notebook says of the time that it takes."""

import re

import jupytext
import pytest

from workbook.outcomes import notebook_files

SOURCES = notebook_files("py")
# The rule: words a minute, lines of visible code a minute, and minutes for a displayed equation.
WORDS, LINES, EQUATION = 200, 20, 0.25


def reading_minutes(cells):
    """Minutes to read a notebook's text, equations and the code that is not folded."""
    text = "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
    equations = re.findall(r"\$\$.*?\$\$", text, re.DOTALL)
    words = re.sub(r"\$\$.*?\$\$", "", text, flags=re.DOTALL).split()
    code = [cell for cell in cells if cell.cell_type == "code"]
    shown = [cell for cell in code if not cell.metadata.get("jupyter", {}).get("source_hidden")]
    lines = [line for cell in shown for line in cell.source.splitlines() if line.strip()]
    return len(words) / WORDS + len(lines) / LINES + EQUATION * len(equations)


@pytest.mark.parametrize("name", SOURCES)
def test_the_head_says_how_long_reading_and_running_take(name):
    cells = jupytext.read(SOURCES[name]).cells
    head = " ".join(cells[0].source.split())
    said = re.search(r"Reading time: (\d+) min\. Run time: \d+ (?:s|min)\.", head)
    assert said, "no times at the head"
    assert int(said[1]) == pytest.approx(reading_minutes(cells), abs=1)
