"""The prefilter: magnitude fit, cascade of sections, felt weighting."""
