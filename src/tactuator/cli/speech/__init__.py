"""Verbs that bring speech to fingers: waveforms, render, play, corpus."""
