"""Verbs that measure a display: noise, measure, disturb."""
