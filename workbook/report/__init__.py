"""What a reader sees: the report, the notebooks' pages, the article, and the same on a terminal."""

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent / "templates"),
    autoescape=lambda name: name is not None and name.endswith((".html.j2", ".css.j2")),
    undefined=StrictUndefined,
    trim_blocks=True,
)
