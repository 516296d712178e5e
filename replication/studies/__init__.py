"""What goes beyond the paper: where searches end, limits, accuracy, robustness, scores, timings."""
