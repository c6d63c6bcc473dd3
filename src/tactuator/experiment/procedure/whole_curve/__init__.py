"""A whole threshold curve in one run: each trial chooses its frequency and its level."""
