"""Every executed notebook as a page for a browser: no script, no network, light, and linked."""

import base64
import html
import json
import posixpath
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import nbformat
import pandas as pd
from latex2mathml.converter import convert
from nbconvert.filters import Highlight2HTML, ansi2html
from nbconvert.filters.markdown_mistune import IPythonRenderer, MarkdownWithMath
from nbformat.v4 import new_markdown_cell

from replication import published
from workbook import judging
from workbook.animation import reduce_png
from workbook.checkout import NOTEBOOKS, notebook_files
from workbook.outcomes import FIGURE
from workbook.report import TEMPLATES
from workbook.report.cells import notebook_source
from workbook.report.figures import Picture, load_pictures

EQUATION = re.compile(r"\$\$.*?\$\$", re.DOTALL)
TEXTS = sorted(NOTEBOOKS.glob("*.md"))
HEADING = re.compile(r"^#{1,4} (.+)$", re.MULTILINE)
TABLE_NUMBER = re.compile(r"<td>(-?\d+\.\d+(?:e[+-]?\d+)?|-?\d+e[+-]?\d+)</td>")
LONG_NUMBER = re.compile(r"-?\d+\.\d{7,}(?!\d|e)")
# Not to be broken into lines.
SHORT_TEXT = re.compile(r"<(th)>([^<]{1,14})</th>|<(td)>([A-Za-z][^<]{0,40})</td>")
# Code without a colour.
UNCOLOURED = re.compile(r'<span class="(?:[npow]|m[if]|n[acdefnv]|vm)">([^<]*)</span>')
SCRIPT = "<script"  # an animation has one
DIGITS = 4  # of a number in a table; the exported CSV has six
SCROLLS = '<div class="wide" tabindex="0" role="group" aria-label="table, scrolls sideways">'
Notebook = Sequence[nbformat.NotebookNode]
# Of careful reading.
WORDS_A_MINUTE = 150
LINE_S = 8
EQUATION_S = 60


def render_pages(results: Path, verdicts: pd.DataFrame) -> dict[str, str]:
    """Render the page of every executed notebook beside the results, by its file below these."""
    pictures = load_pictures(results)
    claims = judging.decided_claims(results)
    judged = verdicts.join(published.cells()["element"], on="id")
    found: dict[str, Notebook] = {}
    sources = {}
    for name, file in notebook_files("ipynb", results.parent / "notebooks").items():
        if name in notebook_files("py"):
            found[name] = nbformat.read(file, as_version=4).cells
            sources[name] = notebook_source(name)
    for file in TEXTS:
        found[file.stem] = [new_markdown_cell(file.read_text("utf-8"))]
        sources[file.stem] = f"notebooks/{file.name}"
    contents = {name: headings(cells) for name, cells in found.items()}
    book = {"contents": contents, "groups": group_pages(sources)}
    pages = {}
    for name, cells in found.items():
        shown = list(_page_cells(cells, sources[name], pictures))
        pages[f"pages/{name}.html"] = TEMPLATES.get_template("notebook.html.j2").render(
            book,
            name=name,
            source=sources[name],
            cells=shown,
            has_script=any(SCRIPT in output for cell in shown for output in cell["outputs"]),
            judged=judged[judged["notebook"] == name].to_dict("records"),
            claims=(claims["notebook"] == name).sum(),
            minutes=reading_minutes(cells) if sources[name].endswith(".py") else "",
        )
    pages["pages/search.html"] = TEMPLATES.get_template("search.html.j2").render(
        book, index=search_index(contents)
    )
    # Pages that a reader can play with, for which notebooks exported data.
    for file in (results / "pages").glob("*_explorer.json"):
        drawn = json.loads(file.read_bytes())
        template = TEMPLATES.get_template(f"{file.stem}.html.j2")
        pages[f"pages/{file.stem}.html"] = template.render(drawn, published=published)
    return pages


def group_pages(sources: Mapping[str, str]) -> dict[str, list[str]]:
    """Names of pages by what they belong to, in reading order."""
    groups: dict[str, list[str]] = {"The paper": [], "Beyond the paper": [], "Reference": []}
    for name, source in sources.items():
        group = "Beyond the paper" if "/beyond/" in source else "The paper"
        groups["Reference" if source.endswith(".md") else group].append(name)
    return groups


def reading_minutes(cells: Notebook) -> int:
    """Minutes of careful reading: words, lines of the code that is shown, displayed equations."""
    text = "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
    folded = {"plumbing", "solution"}
    lines = [
        line
        for cell in cells
        if cell.cell_type == "code" and not folded.intersection(cell.metadata.get("tags", []))
        for line in cell.source.splitlines()
        if line.strip()
    ]
    words = len(re.findall(r"\S*\w\S*", EQUATION.sub("", text)))  # no marks of headings and lists
    seconds = 60 * words / WORDS_A_MINUTE
    seconds += LINE_S * len(lines) + EQUATION_S * len(EQUATION.findall(text))
    return round(seconds / 60)


def search_index(contents: Mapping[str, Sequence[str]]) -> list[list[str]]:
    """Every heading and term: its text, its page's title, its address."""
    return [
        [plain_heading(text), plain_heading(texts[0]), f"{name}.html#{anchor(text)}"]
        for name, texts in contents.items()
        for text in texts
    ]


def plain_heading(text: str) -> str:
    """A heading without anchors and the signs of its formulas."""
    return re.sub(r"<.*?>|[$\\{}]", "", text)


def anchor(text: str) -> str:
    """The anchor of a heading: the one that it names itself, or its slug."""
    named = re.search(r'id="(.*?)"', text)
    return named[1] if named else slug(text)


TEMPLATES.globals.update(plain=plain_heading, anchor=anchor)


def headings(cells: Notebook) -> list[str]:
    """A notebook's headings, formulas as they are written: the first is its title."""
    texts = [cell.source for cell in cells if cell.cell_type == "markdown"]
    return [heading for text in texts for heading in HEADING.findall(text)]


def slug(text: str) -> str:
    """Turn a heading into an anchor: small letters and digits, joined by hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", re.sub(r"[$\\]", "", text.lower())).strip("-")


def cell_anchors(cells: Notebook) -> list[str]:
    """Name each cell after the heading above it and its place there, whatever stands elsewhere."""
    section, position = "top", 0
    anchors = []
    for cell in cells:
        if found := headings([cell]):
            section, position = slug(found[-1]), 0
        position += 1
        anchors.append(f"{section}-cell-{position}")
    return anchors


def _page_cells(cells: Notebook, source: str, pictures: list[Picture]) -> Iterator[dict]:
    """A notebook's cells as HTML, but for plumbing; a figure stands under the cell that draws it."""
    highlight = Highlight2HTML(pygments_lexer="python3")
    for cell, anchor in zip(cells, cell_anchors(cells), strict=True):
        tags = cell.metadata.get("tags", [])
        kind = "solution" if "solution" in tags else cell.cell_type
        made = cell.get("outputs", [])
        figures = {output.get("metadata", {}).get(FIGURE) for output in made}
        if kind == "markdown":
            body = render_markdown(cell.source, source)
        elif "plumbing" not in tags:
            body = UNCOLOURED.sub(r"\1", highlight(cell.source))
        elif any("text/markdown" in output.get("data", {}) for output in made):
            body = ""
        else:
            continue  # it says nothing
        yield {
            "anchor": anchor,
            "kind": kind,
            "body": body,
            "outputs": [
                _render_output(output, source)
                for output in made
                if FIGURE not in output.get("metadata", {})
            ],
            "pictures": [picture for picture in pictures if picture.name in figures],
        }


def _render_output(output: nbformat.NotebookNode, source: str) -> str:
    """An output as HTML."""
    if output.output_type == "stream":
        return f"<pre>{ansi2html(output.text)}</pre>"
    data = output.data
    if "image/png" in data:
        picture = reduce_png(base64.b64decode(data["image/png"]))
        return f'<img alt="a drawing that the cell above makes" src="{picture}">'
    if "text/markdown" in data:
        return render_markdown(data["text/markdown"], source)
    if "text/html" in data:
        text = data["text/html"]
        return text if SCRIPT in text else _render_table(text)
    plain = LONG_NUMBER.sub(lambda found: _shorten(found[0]), data.get("text/plain", ""))
    return f"<pre>{ansi2html(plain)}</pre>"


def _render_table(text: str) -> str:
    """A data frame as a plain table that scrolls by itself where it is wide, with few digits."""
    text = re.sub(r"<style.*?</style>|</?div>", "", text, flags=re.DOTALL)
    text = re.sub(r' border="1" class="dataframe"| style="text-align: right;"', "", text)
    text = text.replace("<th></th>", '<td class="corner"></td>')
    text = text.replace("<td>NaN</td>", "<td>–</td>")
    text = SHORT_TEXT.sub(r'<\1\3 class="short">\2\4</\1\3>', text)
    text = TABLE_NUMBER.sub(lambda found: f'<td class="number">{_shorten(found[1])}</td>', text)
    return f"{SCROLLS}{text.strip()}</div>"


def _shorten(number: str) -> str:
    return f"{float(number):.{DIGITS}g}"


# Markdown with its formulas as MathML, which browsers draw without a script or a network


class _Renderer(IPythonRenderer):
    """Renders formulas as MathML, headings with their anchors, links as they lead from a page."""

    def __init__(self, source: str, notebook: str) -> None:
        super().__init__(escape=False, exclude_anchor_links=True)
        self.notebook = notebook
        self.anchors = iter([anchor(text) for text in HEADING.findall(source)])

    def link(self, text: str, url: str, title: str | None = None) -> str:
        if not re.match(r"#|\w+:", url):
            url = posixpath.normpath(posixpath.join("../..", self.notebook, "..", url))
            url = re.sub(r".*/(\d\d_\w+)\.ipynb|.*/notebooks/(\w+)\.md", r"\1\2.html", url)
        return super().link(text, url, title)

    def inline_math(self, body: str) -> str:
        return _render_formula(body, "inline")

    def block_math(self, body: str) -> str:
        return _render_formula(body, "block")

    def heading(self, text: str, level: int, **attrs: object) -> str:
        text = re.sub(r"<a id=.*?></a>", "", text)
        return f'<h{level} id="{next(self.anchors)}">{text}</h{level}>\n'


def _render_formula(latex: str, display: str) -> str:
    """Turn a formula into MathML, its source as what is read where MathML is not known."""
    latex = latex.strip()
    focus = ' tabindex="0"' if display == "block" else ""  # a wide one scrolls by keyboard too
    named = f'<math alttext="{html.escape(latex)}"{focus} '
    known = latex.replace("\\tag{", "\\qquad\\tag{").replace("\\arg", "\\mathrm{arg}\\,")
    drawn = convert(known, display=display)
    return drawn.replace("<math ", named)


def render_markdown(source: str, notebook: str) -> str:
    """Turn a notebook's markdown into a page's HTML, headings with their slug as id."""
    text = str(MarkdownWithMath(renderer=_Renderer(source, notebook))(source))
    return text.replace("<table>", f"{SCROLLS}<table>").replace("</table>", "</table></div>")
