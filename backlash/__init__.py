"""The virtual sensor for backlash on an engineer's own logs, and what goes beyond the paper.

In three lines, with time [s] and motor speed [rps] as arrays, a table, or a log file::

    import backlash
    answer = backlash.estimate(t, v, turn_period_s=0.4)
    print(answer.verdict, answer.backlash_rad, answer.backlash_interval_rad)
"""

from importlib import import_module

__version__ = "0.1.0"
_MODULE_OF = {
    "Calibration": "calibration",
    "Estimate": "answers",
    "Log": "reading.prepare",
    "Trend": "trend_line",
    "Refusal": "refusals",
    "calibrate": "interface",
    "estimate": "interface",
    "estimate_many": "plant",
    "read_log": "interface",
    "trend": "interface",
    "trend_many": "plant",
}
__all__ = list(_MODULE_OF)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> object:
    """Import what is asked for when it is asked for: `backlash --help` needs none of it."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'backlash' has no attribute {name!r}")
    return getattr(import_module(f"backlash.{_MODULE_OF[name]}"), name)
