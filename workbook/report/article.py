"""The replication article: typeset from a text whose every number comes from the results."""

import json
import math
import re
from pathlib import Path

from replication import files
from workbook import judging
from workbook.report.cells import Cell, judged_cells, judged_claims, like_printed
from workbook.report.facts import collect_facts, fill_in_findings, list_rules

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
    return {
        "facts": facts,
        "cells": [_beside(cell) for cell in judged_cells(verdicts).values()],
        "claims": judged_claims(results),
        "open": [each["text"] for each in fill_in_findings(facts) if each["kind"] == "open"],
        "rules": list_rules(facts),
    }


def _beside(cell: Cell) -> dict:
    """A printed number and ours, as the article's tables have them."""
    names = ("element", "row", "column", "printed", "published", "ours", "agreement", "weak")
    return {name: getattr(cell, name) for name in (*names, "sign", "settings", "unit")} | {
        "low": like_printed(cell.low, cell.printed),
        "high": like_printed(cell.high, cell.printed),
        "resolution": cell.resolution if math.isfinite(cell.resolution) else None,
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
