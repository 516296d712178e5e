"""Sphinx's settings of the book: the report as its first page, then the notebooks, glossary and guide."""

from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

from workbook.project import SETTINGS

project = SETTINGS["title"]
extensions = ["myst_nb", "sphinx.ext.mathjax", "sphinx-mathjax-offline"]
root_doc = "results/report"
include_patterns = ["results/report.md", "notebooks/**"]
exclude_patterns = ["**/.ipynb_checkpoints"]
nb_execution_mode = "off"
nb_render_markdown_format = "myst"
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
html_theme = "furo"
html_show_copyright = False
html_title = project
html_copy_source = False

# The book's contents, which the report does not show where it is read by itself.
CONTENTS = """
```{toctree}
:hidden:
:glob:
:caption: The paper
/notebooks/[0-9]*
```

```{toctree}
:hidden:
:glob:
:caption: Beyond the paper
/notebooks/beyond/*
```

```{toctree}
:hidden:
:caption: Reference
/notebooks/glossary
/notebooks/guide
/notebooks/datasheet
/notebooks/next_paper
```
"""
# What scrolls can be reached by the keyboard.
FOCUS = """addEventListener("load", () => document.querySelectorAll(
  "pre, .table-wrapper, .output, mjx-container, .math").forEach(each => { each.tabIndex = 0; }));
"""
# A page by itself, which has no contents beside it.
EXPLORE = "notebooks/explore.html"
BACK = ' <a href="../results/report.html">To the book</a>'
FIRST_PAGE = '<meta http-equiv="refresh" content="0; url=results/report.html">\n'


def setup(app: Sphinx) -> None:
    """Add the contents to the report, a first page that leads to it, and what a keyboard or a screen reader needs."""
    # It adds a script, and reads no page; by itself it does not say so.
    app.extensions["sphinx-mathjax-offline"].parallel_read_safe = True
    app.add_js_file(None, body=FOCUS)
    app.connect("html-page-context", give_captions_a_level, priority=900)  # after the theme
    app.connect("source-read", add_contents)
    app.connect("doctree-read", leave_formulas)
    app.connect("build-finished", add_pages)


def add_contents(app: Sphinx, document: str, source: list[str]) -> None:
    """Add the contents to the source of the report."""
    if document == root_doc:
        source[0] += CONTENTS


def leave_formulas(app: Sphinx, document: nodes.document) -> None:
    """Keep Sphinx from putting a formula of several lines into an environment that allows no tag."""
    for formula in document.findall(nodes.math_block):
        if not formula["nowrap"]:
            formula[:] = [nodes.Text(rf"\[{formula.astext()}\]")]
            formula["nowrap"] = True


def give_captions_a_level(
    app: Sphinx, page: str, template: str, context: dict[str, Any], document: Any
) -> None:
    """Say which level of heading the captions of the contents have."""
    tree = context.get("furo_navigation_tree", "")
    context["furo_navigation_tree"] = tree.replace(
        'role="heading"', 'role="heading" aria-level="2"'
    )


def add_pages(app: Sphinx, error: Exception | None) -> None:
    """Write `index.html`, copy the page to play with, and give it a way back."""
    Path(app.outdir, "index.html").write_text(FIRST_PAGE, encoding="utf-8")
    page = Path(app.srcdir, EXPLORE).read_text(encoding="utf-8")
    Path(app.outdir, EXPLORE).write_text(page.replace("<!-- book -->", BACK), encoding="utf-8")
