"""The virtual sensor on an engineer's own logs."""

from replication.methods import METHODS

SELF = "self"
SENSOR_METHODS = (*METHODS, SELF)
UNITS = ("rps", "rpm", "rad/s", "counts")
