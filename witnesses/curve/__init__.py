"""Whole curves of people who are not like the procedure's prior."""
