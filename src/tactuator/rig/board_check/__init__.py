"""Checks that compare a board with this machine: bit for bit, and while it streams."""
