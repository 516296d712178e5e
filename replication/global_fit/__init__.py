"""A deterministic global fit of the signature, with an interval of A."""
