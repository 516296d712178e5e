"""Results to pages: the report, and the README's blocks."""

import base64
import html
import json
import re
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from replication import published, workbook
from replication.workbook import files, judging, provenance

# Signs beside the words, so that colour is never the only one.
SIGNS = {
    "reproduced": "✓",
    "erratum": "‡",
    "stand-in": "≈",
    "differs": "✗",
    "not-run": "–",
    "holds": "✓",
    "does not hold": "✗",
    "not decided": "–",
    "consistent": "=",
    "given": "→",
    "undecided": "?",
}
LARGEST_SVG = 300_000  # bytes; a larger figure goes in as PNG
FIGURE_NAME = re.compile(r"(figure|table|equation)0*(\d+)_")


@dataclass(frozen=True)
class Picture:
    """A figure of the report: its name, the notebook that made it, what it shows and the drawing itself."""

    name: str
    notebook: str
    caption: str
    drawing: Markup

    @property
    def element(self) -> str:
        """Element of the paper that its file name belongs to; empty for what goes beyond it."""
        found = FIGURE_NAME.match(self.name)
        return f"{found[1].capitalize()} {found[2]}" if found else ""


# ---------------------------------------------------------------------------------------------------------------
# Figures


def pictures(figures: Path, notebooks: Path) -> list[Picture]:
    """Every figure that a notebook's source exports by name, in the notebooks' order.

    Parameters
    ----------
    figures, notebooks : Path
        Folders of the SVG and PNG files, and of the notebooks' sources.

    Returns
    -------
    list of Picture
        Captioned by the heading above the cell that exports the figure, or else by the notebook's title.
    """
    found = []
    for source in sorted(notebooks.glob("[0-9]*.py")):
        heading = ""
        for line in source.read_text(encoding="utf-8").splitlines():
            if re.match(r"# (#|###) ", line):
                heading = line.lstrip("# ")
            for name in re.findall(r"save_figure\(\w+, \"(\w+)\"", line):
                if (figures / f"{name}.svg").exists():
                    found.append(Picture(name, source.stem, heading, _drawing(figures / f"{name}.svg", heading)))
    return found


def _drawing(file: Path, caption: str) -> Markup:
    """Inline a figure: its SVG, or its PNG where the SVG is large."""
    text = file.read_text(encoding="utf-8")
    described = re.search(r"<dc:description>(.*?)</dc:description>", text, re.DOTALL)
    label = html.escape(caption) + (f": {_plain(described[1])}" if described else "")
    if len(text) > LARGEST_SVG:
        data = base64.b64encode(file.with_suffix(".png").read_bytes()).decode("ascii")
        return Markup(f'<img alt="{label}" src="data:image/png;base64,{data}">')
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    return Markup(_unique_ids(text, file.stem).replace("<svg", f'<svg role="img" aria-label="{label}"', 1))


def _plain(label: str) -> str:
    """An axis label without its mathematical markup, for reading aloud."""
    for markup, sign in (("\\delta", "δ"), ("\\Delta", "Δ"), ("\\theta", "θ"), ("\\pm", "±")):
        label = label.replace(markup, sign)
    return re.sub(r"[${}\\]", "", label)


def _unique_ids(svg: str, stem: str) -> str:
    """Prefix an SVG's ids by its file's name, so that figures of one page do not share markers."""
    for start in ('id="', 'href="#', "url(#"):
        svg = svg.replace(start, f"{start}{stem}-")
    return svg


# ---------------------------------------------------------------------------------------------------------------
# Tables


def _number(value: float) -> str:
    return "" if pd.isna(value) else f"{value:.5g}"


def _cell_rows(table: pd.DataFrame) -> tuple[list[dict], dict[str, str]]:
    """An element's verdicts as rows of text, and the reasons that their letters point to."""
    printed = published.cells()
    letters: dict[str, str] = {}

    def letter(text: str) -> str:
        return letters.setdefault(text, _letter(len(letters)))

    rows = [
        row
        | {name: _number(row[name]) for name in ("reproduced", "difference")}
        | {
            "tolerance": f"± {row['tolerance']:.3g}",
            "tolerance_note": letter(printed.loc[row["id"], "tol_reason"]),
            "reason_note": "" if row["verdict"] == "reproduced" else letter(_why(row)),
            "unit": printed.loc[row["id"], "unit"].replace("%", ""),
            "notebook": row["notebook"] if isinstance(row["notebook"], str) else "",
        }
        for row in table.to_dict("records")
    ]
    return rows, {name: text for text, name in letters.items()}


def _why(row: dict) -> str:
    return f"corrected: {row['reason']}" if row["verdict"] == "erratum" else row["reason"]


def _letter(position: int) -> str:
    return ("" if position < 26 else _letter(position // 26 - 1)) + chr(ord("a") + position % 26)


def _elements(verdicts: pd.DataFrame, drawn: list[Picture]) -> list[dict]:
    """Tables, equation 10, figures and the text: each with its cells and figures, where it has any."""
    mapped = published.paper_map().set_index("element")
    element = published.cells()["element"].reindex(verdicts["id"]).to_numpy()
    names = list(dict.fromkeys([*published.cells()["element"], *sorted({p.element for p in drawn} - {""}, key=_order)]))
    parts = []
    for name in sorted(names, key=_order):
        rows, notes = _cell_rows(verdicts[element == name])
        about = mapped.loc[name].to_dict() if name in mapped.index else {"what": "", "note": ""}
        figures = [picture for picture in drawn if picture.element == name]
        anchor = name.lower().replace(" ", "-")
        parts.append({"name": name, "anchor": anchor, "rows": rows, "notes": notes, "figures": figures} | about)
    return parts


def _order(element: str) -> tuple[int, int]:
    """Tables, equations, figures, then the rest, each by number."""
    kind, number = re.match(r"(\w+) ?(\d*)", element).groups()
    kinds = ["Table", "Equation", "Figure", "Text", "claims", "tests"]
    return (kinds.index(kind) if kind in kinds else len(kinds), int(number) if number.isdigit() else 0)


def _claims(results: Path) -> list[dict]:
    """The claims with their checks and decisions."""
    decided = pd.read_csv(results / "claims.csv", keep_default_na=False).set_index("id")
    rows = published.claims().join(decided[["verdict", "measured", "notebook"]]).fillna("").reset_index()
    return [row | {"verdict": row["verdict"] or "not decided"} for row in rows.to_dict("records")]


def _sensitivity(results: Path) -> tuple[list[dict], list[str]]:
    """The matrix of `sensitivity.csv`: one row per constant, how many cells of each group notice it."""
    file = results / "sensitivity.csv"
    if not file.exists():
        return [], []
    table = pd.read_csv(file, keep_default_na=False)
    columns = sorted(dict.fromkeys(name for name in table["group"] if name), key=_order)
    rows = []
    for (constant, value, changed), part in table.groupby(["constant", "value", "changed"], sort=False):
        noticed = part[part["group"] != ""]
        counts = noticed["group"].value_counts()
        examples = list(noticed.drop_duplicates("group")["id"])
        counted = {name: int(counts.get(name, 0)) for name in columns}
        rows.append({"constant": constant, "value": value, "changed": changed, "counts": counted})
        rows[-1]["examples"] = ", ".join(examples) or "nothing"
    return rows, columns


def _versions(made_from: dict[str, dict]) -> dict[str, str]:
    """Versions of Python and of the packages that the results were made with, by name."""
    found: dict[str, set[str]] = {}
    for record in made_from.values():
        for name, version in ({"Python": record["python"]} | record["packages"]).items():
            found.setdefault(name, set()).add(version)
    return {name: " and ".join(sorted(versions)) for name, versions in sorted(found.items())}


# ---------------------------------------------------------------------------------------------------------------
# Pages


def page(results: Path, notebooks: Path, quick: bool = False) -> str:
    """Render the report.

    Parameters
    ----------
    results : Path
        Folder of the results; the figures are in the folder `figures` beside it.
    notebooks : Path
        Folder of the notebooks' sources.
    quick : bool
        Say that these are the results of a quick run.

    Returns
    -------
    str
        One HTML page that needs nothing else.
    """
    verdicts = judging.verdicts(results)
    counts = judging.verdict_counts(verdicts).reset_index()
    drawn = pictures(results.parent / "figures", notebooks)
    elements, claims = _elements(verdicts, drawn), _claims(results)
    sensitivity, columns = _sensitivity(results)
    made_from = json.loads((results / "provenance.json").read_text(encoding="utf-8"))
    with_rows = [part["name"] for part in elements]
    kinds = [*counts.columns[2:], *dict.fromkeys(row["verdict"] for row in claims)]
    environment = Environment(
        loader=PackageLoader("replication.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return environment.get_template("report.html.j2").render(
        quick=quick,
        replicated=", ".join(with_rows[:-1]) + f" and the {with_rows[-1].lower()}'s claims",
        root="../../.." if quick else "..",
        signs=SIGNS,
        totals=counts.drop(columns=["element", "source"]).sum().to_dict(),
        counts=counts.to_dict("records"),
        versions=_versions(made_from),
        stale=provenance.stale(results),
        filters={"verdict": kinds, "element": [*with_rows, "Claims"], "source": sorted(set(verdicts["source"]))},
        elements=elements,
        claims=claims,
        claims_hold=sum(row["verdict"] == "holds" for row in claims),
        errata=published.errata().reset_index().to_dict("records"),
        sensitivity=sensitivity,
        sensitivity_columns=columns,
        unnoticed=sum(not any(row["counts"].values()) for row in sensitivity),
        beyond=[picture for picture in drawn if not picture.element],
        map=published.paper_map().to_dict("records"),
    )


def write_page(results: Path) -> Path:
    """Write `report.html` beside the results: one self-contained page.

    Parameters
    ----------
    results : Path
        Folder of the results.

    Returns
    -------
    Path
    """
    quick = results == workbook.QUICK / "results"
    path = results / "report.html"
    files.write_text(path, page(results, workbook.ROOT / "notebooks", quick))
    return path


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
