"""Figures of a device: calibration, identification, motor, noise, response."""
