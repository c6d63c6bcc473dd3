"""Simulated subjects, and the quality of procedures measured with them."""
