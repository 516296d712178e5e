"""The virtual sensor on an engineer's own logs, and what goes beyond the paper.

How to ask for a log::

    from pathlib import Path
    from backlash import LogFormat, estimate, settings_for
    answer = estimate(Path("log.csv"), settings_for(LogFormat(turn_period_s=0.4)))
    print(answer.verdict, answer.backlash_rad, answer.backlash_interval_rad)
"""

from importlib import import_module

import replication  # noqa: F401  first: it says where compiled code is kept

_MODULE_OF = {
    "Calibration": "calibration", "Estimate": "estimation", "LogFormat": "reading.columns", "Settings": "estimation",
    "Trend": "trend", "UnusableLog": "reading.tables", "calibrate": "calibration", "dates_of": "trend",
    "estimate": "estimation", "find_logs": "fleet", "fit_trend": "trend", "prepared_record": "estimation",
    "run_fleet": "fleet", "settings_for": "estimation",
}  # fmt: skip
__all__ = list(_MODULE_OF)


def __getattr__(name: str) -> object:
    """Import what is asked for when it is asked for: `backlash --help` needs none of it."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'backlash' has no attribute {name!r}")
    return getattr(import_module(f"backlash.{_MODULE_OF[name]}"), name)
