"""Ways to tell the backlash of a joint from a log."""

# Those with a calibration. "impact" comes besides: it needs records that all start at one angle of the load.
METHODS = ("paper", "amplitude", "energy", "waveform")
