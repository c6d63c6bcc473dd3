"""Equally strong, on a person whose law nobody who designs has seen."""
