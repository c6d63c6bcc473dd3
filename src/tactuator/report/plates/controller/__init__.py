"""Figures of a controller: loop, prefilter, headroom, word length, configuration."""
