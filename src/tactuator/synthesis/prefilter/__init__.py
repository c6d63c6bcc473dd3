"""The prefilter: fit to the threshold curve, cascade of sections, felt weighting."""
