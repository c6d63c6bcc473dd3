"""Filters and systems of a given magnitude: least greatest error in dB, stable, minimum phase."""
