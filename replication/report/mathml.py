"""Markdown with its formulas as MathML, which browsers draw without a script or a network."""

import html
import re

from latex2mathml.converter import convert
from nbconvert.filters.markdown_mistune import IPythonRenderer, MarkdownWithMath

from replication.report.where import slug

FORMULA = re.compile(r'<math[^>]*? alttext="([^"]*)".*?</math>', re.DOTALL)
TAG = re.compile(r"<[^>]+>")


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
        return f'<h{level} id="{slug(written)}">{text}</h{level}>\n'


def formula(latex: str, display: str = "inline") -> str:
    """Turn a formula into MathML, its source as what is read where MathML is not known."""
    return convert(latex.strip(), display=display).replace("<math ", f'<math alttext="{html.escape(latex.strip())}" ')


def markdown(source: str) -> str:
    """Turn a notebook's markdown into HTML: formulas between dollar signs as MathML, headings with their slug as id."""
    return MarkdownWithMath(renderer=_Renderer())(source)
