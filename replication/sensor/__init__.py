"""The virtual sensor on an engineer's own logs."""
