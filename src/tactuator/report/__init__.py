"""Figures and pages from results: the only floor that draws."""
