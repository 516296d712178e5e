"""Ways from a record to backlash beyond equation 10, and their calibration."""
