"""Clips of public collections."""
