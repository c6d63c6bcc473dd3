"""Measurements of a display on any rig: responses, disturbances, noise, and the felt level of a reference."""
