"""Loops: what the synthesis delivers, and the best that is known."""
