"""Clips of other people's formats: what they ask for, and what a display makes of it, in dB SL."""
