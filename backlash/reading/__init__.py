"""From an untrusted file to a clean record, and whether there is a pattern in it."""

UNITS = ("rps", "rpm", "rad/s", "deg/s", "counts")
