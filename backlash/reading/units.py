"""Units of columns: what loggers call them, and how they spell these."""

import json
import re
import unicodedata
from pathlib import Path
from typing import Any

KNOWN: dict[str, Any] = json.loads(
    Path(__file__).parents[1].joinpath("data", "column_names.json").read_text("utf-8")
)
PER_TURN: dict[str, float] = KNOWN["per_turn"]
SECONDS: dict[str, float] = KNOWN["seconds"]
_LONGEST_NAME = 200  # of a column; the rest says nothing
_INDEX = re.compile(r"(\s*[\[(]\d+[\])]|[\s_.]\d+)$")  # of a joint, or of one name among equal ones
# As in "rpm/1000", "[rpm] (x10)" and "0.1 rpm".
_SCALE = re.compile(r"%|(?:[×*/·]|(?<![a-z])x)\s*10|10\s*[\^*]|\d[.,]\d+[\s_]*[^\s_.]+$")


def known_unit(text: str) -> str:
    """A unit's one name, from any of its spellings; "" if it is none."""
    text = unicodedata.normalize("NFKC", text.strip()).lower()
    spelled = (
        unit
        for unit, spelling in KNOWN["spellings"].items()
        if re.fullmatch(spelling.format(**KNOWN), text)
    )
    return text if text in SECONDS else next(spelled, "")


def split_unit(column: str) -> tuple[str, str]:
    """Name of a column in lower case, and its unit: from "Motor speed [rpm]", "speed.rpm" and "speed_rad_s_1"."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", _INDEX.sub("", column[:_LONGEST_NAME]))
    text = text.strip(" _").lower()
    bracketed = re.fullmatch(r"(.*?)[\s_]*[\[(<](.*?)[\])>](.*)", text)
    if scale := _SCALE.search(text):
        name = bracketed[1] if bracketed else text[: scale.start()]
        return name.strip(" _"), text[len(name) :].strip()
    if bracketed and (not bracketed[3] or known_unit(bracketed[2])):
        return bracketed[1] + bracketed[3], known_unit(bracketed[2]) or bracketed[2].strip()
    for gap in re.finditer(r"[\s_.]+", text):
        if unit := known_unit(text[gap.end() :]):
            return text[: gap.start()].replace("_", " "), unit
    return text, known_unit(text)


def words_of(column: str) -> set[str]:
    """Words of a column's name, without its unit."""
    return set(re.findall(r"[^\W\d_]+", split_unit(column)[0]))
