"""What a designed loop does in time, on plants that are drawn."""
