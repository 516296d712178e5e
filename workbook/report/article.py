"""The replication article: typeset from a text whose every number comes from the results."""

import json
import re
from pathlib import Path

from replication import files
from workbook import judging
from workbook.report.cells import SIGNS, judged_cells, judged_claims
from workbook.report.facts import collect_facts, fill_in_findings

SOURCE = files.ROOT / "article" / "article.typ"
# In these a text that begins with "OPEN: " says what a person has still to fill in.
WITH_BLANKS = ("article/metadata.yaml", "article/references.yml", "CITATION.cff", "codecheck.yml")


class NotTypeset(RuntimeError):
    """The article's text asks for what the results do not have, or typst is not installed."""

    exit_status = 1


def collect_content(results: Path) -> dict:
    """Collect what the article's text takes from the results and does not read itself."""
    verdicts = judging.verdicts(results)
    facts = collect_facts(results, verdicts)
    cells = [
        {
            "element": cell.element,
            "row": cell.row,
            "column": cell.column,
            "printed": cell.printed,
            "ours": cell.ours,
            "agreement": cell.agreement,
            "sign": cell.sign,
            "source": cell.source,
            "unit": cell.unit,
        }
        for cell in judged_cells(verdicts).values()
    ]
    still_open = [each["text"] for each in fill_in_findings(facts) if each["kind"] == "open"]
    return {
        "facts": facts,
        "signs": SIGNS,
        "cells": cells,
        "claims": judged_claims(results),
        "open": still_open,
    }


def typeset(results: Path, final: bool = False) -> bytes:
    """Typeset the article as a PDF, the same for the same results; a final one has no blanks."""
    blanks = [
        f"{file}: {blank}"
        for file in WITH_BLANKS
        for blank in re.findall('"OPEN: (.*?)"', (files.ROOT / file).read_text(encoding="utf-8"))
    ]
    if final and blanks:
        raise NotTypeset(f"not final; a person has to fill in {'; '.join(blanks)}")
    try:
        import typst  # only the article needs it
    except ImportError as error:
        raise NotTypeset(f"{error}: the article needs the extra `article`") from error
    inputs = {"data": json.dumps(collect_content(results))}
    try:
        # Fonts that only this machine has would make other bytes elsewhere.
        return typst.compile(
            str(SOURCE), root=str(files.ROOT), sys_inputs=inputs, ignore_system_fonts=True
        )
    except typst.TypstError as error:
        raise NotTypeset(f"article/article.typ: {error}") from error
