"""What the notebooks beyond the paper compute."""
