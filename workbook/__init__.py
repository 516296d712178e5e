"""The workbook: runs the notebooks, compares what they export with the printed numbers, makes report and book."""

from pkgutil import resolve_name

# What notebooks call; `python -m workbook` needs none of it.
_MODULE_OF = {
    "ROOT": "project",
    "ParameterError": "parameters",
    "check_answer": "teaching",
    "check_bounds": "parameters",
    "check_parameters": "parameters",
    "explain": "parameters",
    "decide_all": "judging",
    "flipbook": "pictures",
    "judge": "judging",
    "read_kept": "outcomes",
    "say": "outcomes",
    "say_path": "teaching",
    "say_times": "teaching",
    "show": "outcomes",
    "show_figure": "outcomes",
    "try_changing": "teaching",
    "verdict": "judging",
}
__all__ = [*_MODULE_OF]


def __getattr__(name: str) -> object:
    """Import what a notebook calls when it is called for."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'workbook' has no attribute {name!r}")
    import pandas as pd

    # Notebooks show tables in full.
    pd.set_option(
        "display.max_colwidth", None, "display.max_columns", None, "display.max_rows", 200
    )
    return resolve_name(f"workbook.{_MODULE_OF[name]}:{name}")
