"""Experiments with a person, or an observer, at the display."""
