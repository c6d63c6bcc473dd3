"""Feedback controllers: the problem, its structures, their synthesis and assessment."""
