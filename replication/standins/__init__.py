"""Simulated stand-ins for the logs of Tables 3 and 4, which were never published."""
