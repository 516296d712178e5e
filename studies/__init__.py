"""What we conclude, and what goes beyond the paper."""
