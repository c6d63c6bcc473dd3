"""Rules that choose the next stimulus and estimate a threshold from the answers."""
