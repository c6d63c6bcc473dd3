"""Rigs on sound cards: PortAudio's streams, their rows and gaps, and what calibrates them."""
