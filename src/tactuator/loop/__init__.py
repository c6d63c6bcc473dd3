"""Feedback loops: L, S, T and H, stability and margins, for continuous and for sampled time."""
