"""Where the committed results and the executed notebooks are."""

import workbook

RESULTS = workbook.ROOT / "results"
NOTEBOOKS = workbook.ROOT / "notebooks"
