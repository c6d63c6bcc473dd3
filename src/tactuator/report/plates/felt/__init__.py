"""Figures of what a person feels: curves, thresholds, equality, speech."""
