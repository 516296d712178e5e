"""Every executed notebook as a page that a browser shows as it is: no script, no network, light, and linked."""

import base64
import html
import re
from dataclasses import dataclass
from pathlib import Path

import nbformat
import pandas as pd
from latex2mathml.converter import convert
from nbconvert.filters import Highlight2HTML, ansi2html
from nbconvert.filters.markdown_mistune import IPythonRenderer, MarkdownWithMath

from replication import published
from replication.report import figures, web
from replication.workbook import files, judging

FORMULA = re.compile(r'<math[^>]*? alttext="([^"]*)".*?</math>', re.DOTALL)
TAG = re.compile(r"<[^>]+>")
TABLE_NUMBER = re.compile(r"<td>(-?\d+\.\d+(?:e[+-]?\d+)?|-?\d+e[+-]?\d+)</td>")
LONG_NUMBER = re.compile(r"-?\d+\.\d{7,}(?!\d|e)")
SHORT_TEXT = re.compile(r"<(th)>([^<]{1,14})</th>|<(td)>([A-Za-z][^<]{0,40})</td>")  # not to be broken into lines
DIGITS = 4  # of a number in a table; the exported CSV has six


@dataclass(frozen=True)
class PageCell:
    """A cell of a page: its anchor, its kind ("markdown" or "code") and its parts as HTML."""

    anchor: str
    kind: str
    body: str
    outputs: tuple[str, ...]
    pictures: tuple[figures.Picture, ...]


def page_cells(notebook: Path, drawn: list[figures.Picture]) -> list[PageCell]:
    """Turn an executed notebook's cells into HTML."""
    content = nbformat.read(notebook, as_version=4)
    anchors = web.cell_anchors([(cell.cell_type, cell.source) for cell in content.cells])
    placed = figures.shown_in(notebook, drawn)
    highlight = Highlight2HTML(pygments_lexer="python3")
    cells = []
    for cell, anchor in zip(content.cells, anchors, strict=True):
        pictures = tuple(placed.get(anchor, ()))
        if cell.cell_type == "markdown":
            cells.append(PageCell(anchor, "markdown", markdown(cell.source), (), ()))
        elif cell.cell_type == "code":
            outputs = [_output(output, bool(pictures)) for output in cell.outputs]
            cells.append(PageCell(anchor, "code", highlight(cell.source), tuple(filter(None, outputs)), pictures))
    return cells


def _output(output: nbformat.NotebookNode, has_picture: bool) -> str:
    """An output as HTML; nothing for a drawing that stands there as an exported figure."""
    if output.output_type == "stream":
        return f"<pre>{ansi2html(output.text)}</pre>"
    if output.output_type == "error":
        return f"<pre>{ansi2html(chr(10).join(output.traceback))}</pre>"
    data = output.data
    if "image/png" in data:
        if has_picture:
            return ""
        picture = figures.light(base64.b64decode(data["image/png"]))
        return f'<img alt="a drawing that the cell above makes" src="{picture}">'
    if "text/html" in data:
        return _table(data["text/html"])
    plain = LONG_NUMBER.sub(lambda found: f"{float(found[0]):.{DIGITS}g}", data.get("text/plain", ""))
    return f"<pre>{ansi2html(plain)}</pre>"


def _table(text: str) -> str:
    """A data frame as a plain table that scrolls by itself where it is wide, with sensible digits."""
    text = re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL)
    text = text.replace(' border="1" class="dataframe"', "").replace(' style="text-align: right;"', "")
    text = re.sub(r"<th></th>", '<td class="corner"></td>', text)
    text = text.replace("<td>NaN</td>", "<td>–</td>")
    text = SHORT_TEXT.sub(r'<\1\3 class="short">\2\4</\1\3>', text)
    text = TABLE_NUMBER.sub(lambda found: f'<td class="number">{float(found[1]):.{DIGITS}g}</td>', text)
    text = re.sub(r"</?div>", "", text)
    return f'<div class="wide" tabindex="0" role="group" aria-label="table, scrolls sideways">{text.strip()}</div>'


def render(
    notebook: Path, decided: list[tuple[str, str, str]], drawn: list[figures.Picture], all_names: list[str]
) -> str:
    """Render a notebook's page."""
    cells = page_cells(notebook, drawn)
    position = all_names.index(notebook.stem)
    return web.ENVIRONMENT.get_template("notebook.html.j2").render(
        name=notebook.stem,
        title=web.title(notebook),
        cells=cells,
        before=all_names[position - 1] if position else "",
        after=all_names[position + 1] if position + 1 < len(all_names) else "",
        decides=decided,
        contents=[(web.slug(text), text) for text in _sections(notebook)],
    )


def _sections(notebook: Path) -> list[str]:
    """Headings below the title."""
    found = [
        text for kind, source in web.notebook_cells(notebook) if kind == "markdown" for text in web.headings(source)
    ]
    return found[1:]


def decides(name: str, verdicts: pd.DataFrame, claims: pd.DataFrame) -> list[tuple[str, str, str]]:
    """What a notebook decides: the anchor in the report, the element, and its verdicts counted in words."""
    own = verdicts[verdicts["notebook"] == name]
    element = published.cells()["element"].reindex(own["id"]).to_numpy()
    parts = [
        (
            web.slug(str(key)),
            str(key),
            ", ".join(f"{n} {verdict}" for verdict, n in part.value_counts(sort=False).items()),
        )
        for key, part in own["verdict"].groupby(element, sort=False)
    ]
    held = claims[claims["notebook"] == name]
    if len(held):
        parts.append(("claims", "Claims", f"{len(held)} decided"))
    return parts


def write_pages(results: Path, notebooks: Path, verdicts: pd.DataFrame) -> list[Path]:
    """Write a page for each executed notebook into the results' folder `pages`."""
    drawn = figures.pictures(results, results.parent / "figures")
    executed = sorted(notebooks.glob("[0-9]*.ipynb"))
    names = [notebook.stem for notebook in executed]
    claims = judging.decided_claims(results)
    written = []
    for notebook in executed:
        path = results / "pages" / f"{notebook.stem}.html"
        files.write_text(path, render(notebook, decides(notebook.stem, verdicts, claims), drawn, names))
        written.append(path)
    for stale in set((results / "pages").glob("*.html")) - set(written):
        stale.unlink()
    return written


# ---------------------------------------------------------------------------------------------------------------
# Markdown with its formulas as MathML, which browsers draw without a script or a network


class _Renderer(IPythonRenderer):
    """Renders formulas as MathML and headings with anchors that are theirs alone."""

    def __init__(self) -> None:
        super().__init__(escape=False, exclude_anchor_links=True)

    def inline_math(self, body: str) -> str:
        return formula(body)

    def block_math(self, body: str) -> str:
        return formula(body, display="block")

    def latex_environment(self, name: str, body: str) -> str:
        return formula(f"\\begin{{{name}}}{body}\\end{{{name}}}", display="block")

    def heading(self, text: str, level: int, **attrs: object) -> str:
        written = html.unescape(TAG.sub("", FORMULA.sub(r"\1", text)))
        return f'<h{level} id="{web.slug(written)}">{text}</h{level}>\n'


def formula(latex: str, display: str = "inline") -> str:
    """Turn a formula into MathML, its source as what is read where MathML is not known."""
    focus = ' tabindex="0"' if display == "block" else ""  # a wide one scrolls, so the keyboard must reach it
    named = f'<math alttext="{html.escape(latex.strip())}"{focus} '
    return convert(latex.strip(), display=display).replace("<math ", named)


def markdown(source: str) -> str:
    """Turn a notebook's markdown into HTML: formulas between dollar signs as MathML, headings with their slug as id."""
    return MarkdownWithMath(renderer=_Renderer())(source)
