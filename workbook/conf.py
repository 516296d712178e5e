"""Sphinx's settings of the book: the report as its first page, then the notebooks, glossary and guide."""

from pathlib import Path

from sphinx.application import Sphinx

project = "A virtual sensor for backlash: the replication"
extensions = ["myst_nb", "sphinx.ext.mathjax", "sphinx-mathjax-offline"]
root_doc = "results/report"
include_patterns = ["results/report.md", "notebooks/**"]
exclude_patterns = [
    ".*",
    "lab",
    "results/book",
    "results/offline",
    "**.py",
    "**/.ipynb_checkpoints",
]
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
```
"""
FIRST_PAGE = '<meta http-equiv="refresh" content="0; url=results/report.html">\n'


def setup(app: Sphinx) -> None:
    """Add the contents to the report, and a first page that leads to it."""
    app.connect("source-read", add_contents)
    app.connect("build-finished", write_first_page)


def add_contents(app: Sphinx, document: str, source: list[str]) -> None:
    """Add the contents to the source of the report."""
    if document == root_doc:
        source[0] += CONTENTS


def write_first_page(app: Sphinx, error: Exception | None) -> None:
    """Write `index.html`."""
    Path(app.outdir, "index.html").write_text(FIRST_PAGE, encoding="utf-8")
