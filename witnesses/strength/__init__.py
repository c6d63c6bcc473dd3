"""Equally strong, on a person whose function nobody who designs has seen."""
