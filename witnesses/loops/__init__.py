"""Loops: what the synthesis delivers, the best that is known, and a bound that none can beat."""
