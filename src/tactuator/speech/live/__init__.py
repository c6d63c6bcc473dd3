"""Sound to fingers as it comes: sources, clocks, level, limits, and the stream of all of them."""
