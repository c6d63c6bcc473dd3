"""One psychophysical trial: stimulus, timing, presentation, delivered level."""
