"""Figures of the paper, and the style that all figures share."""
