"""The core as Python uses it: images, safety tables, the simulated display."""
