"""Printed numbers, the identified joint, and the way to the authors' files."""
