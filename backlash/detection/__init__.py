"""Detect: whether a record repeats itself from turn to turn as backlash makes it, and with which period."""
