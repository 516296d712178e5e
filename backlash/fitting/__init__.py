"""Ways to read the backlash of a joint from a record."""

# Those with a calibration. "impact" comes besides: it needs records that all start at one angle of
# the load.
METHODS = ("paper", "amplitude", "energy", "waveform")
SELF = "self"
TORQUE = "torque"
SENSOR_METHODS = (*METHODS, SELF, TORQUE)
