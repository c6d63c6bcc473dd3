"""Fingers on one frame, of the witness's own: what couples them, and what one feels of another."""
