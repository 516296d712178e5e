"""Simulated stand-ins for the logs of Tables 3 and 4, which were never published."""

from importlib import import_module
from types import ModuleType

__all__ = ["bench", "joints", "plots", "robots", "wear"]


def __getattr__(name: str) -> ModuleType:
    """One of the modules beside this one, loaded when first named."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module(f"{__name__}.{name}")
