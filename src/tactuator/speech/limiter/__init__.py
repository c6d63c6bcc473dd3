"""Limits on what speech may ask of a display, and the gain reduction that keeps them."""
