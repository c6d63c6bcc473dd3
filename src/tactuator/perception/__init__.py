"""The person: threshold curves and levels."""
