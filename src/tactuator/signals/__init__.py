"""Systems, stimuli, spectra and decibels: the mathematics that knows nothing of displays or people."""
