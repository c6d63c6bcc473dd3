"""Figures of the report, one kind of figure in each module."""
