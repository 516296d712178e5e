"""The simulated joint: its parameters, its compiled core, the simulation and its identification."""

from importlib import import_module

__all__ = ["parameters", "recordings", "simulate"]


def __getattr__(name: str) -> object:
    """One of the modules that notebooks use, loaded when first named."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module(f"{__name__}.{name}")
