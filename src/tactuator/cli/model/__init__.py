"""Verbs from records to models: calibrate, record, identify."""
