"""Prefilters: magnitude fit, cascade of sections, felt weighting."""
