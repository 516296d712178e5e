"""The virtual sensor for backlash on an engineer's own logs.

With time [s], motor speed and motor torque as arrays, or a table, or a log file. The unit of the speed is asked for::

    import backlash
    answer = backlash.estimate(
        t, v, unit="rps", torque=torque, gear_ratio=100, inertia_ratio=2.0, gravity_per_s2=30.0
    )
    print(answer.verdict, answer.backlash_rad, answer.backlash_interval_rad)
"""

from importlib import import_module

__version__ = "1.0.0"
_MODULE_OF = {
    "Estimate": "answer",
    "Reason": "refusals",
    "Refusal": "refusals",
    "estimate": "estimates",
    "estimate_many": "batch",
}
__all__ = list(_MODULE_OF)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> object:
    """Import what is asked for when it is asked for: `backlash --help` needs none of it."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'backlash' has no attribute {name!r}")
    return getattr(import_module(f"backlash.{_MODULE_OF[name]}"), name)
